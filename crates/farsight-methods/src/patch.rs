//! A config that says what is other than in another one: arms of an experiment, parts of a training.

use toml::{Table, Value};

/// Lays `patch` over `config`: tables are joined, all else is replaced. A table with a `rule` or `kind` of its own is
/// one value, as its fields go with it.
pub fn lay_over(config: &mut Table, patch: &Table) {
    for (name, value) in patch {
        match (config.get_mut(name), value) {
            (Some(Value::Table(old)), Value::Table(new)) if !new.contains_key("rule") && !new.contains_key("kind") => {
                lay_over(old, new);
            }
            _ => {
                config.insert(name.clone(), value.clone());
            }
        }
    }
}
