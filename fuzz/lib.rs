//! The laws of `farsight-laws`, by name.

/// Feeds `bytes` to the law of the target called `name`.
///
/// # Panics
/// When the law is broken, and when there is no such target.
pub fn law(name: &str, bytes: &[u8]) {
    let target = farsight_laws::named(name).unwrap_or_else(|| panic!("no target {name}"));
    // Most mutants are refused.
    let _ = (target.law)(bytes);
}
