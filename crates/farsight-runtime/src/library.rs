//! Calls of the libraries that engines are made of. They are other people's code under a stranger's model, and they may
//! panic.

use std::any::Any;
use std::error::Error;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::EngineError;

/// What a library says when it fails.
pub(crate) type Failure = Box<dyn Error + Send + Sync>;

/// How many calls are going on.
static INSIDE: AtomicUsize = AtomicUsize::new(0);

/// Whether a library of an engine is at work. A panic is then caught and becomes an [`EngineError`], so a program's
/// panic hook need not report it.
pub fn inside_library() -> bool {
    INSIDE.load(Ordering::Relaxed) > 0
}

/// The answer of `work`; a panic becomes an error, because a model from a stranger may hit an assumption of the
/// library.
pub(crate) fn unpanicked<T>(engine: &str, work: impl FnOnce() -> Result<T, Failure>) -> Result<T, EngineError> {
    INSIDE.fetch_add(1, Ordering::Relaxed);
    let answer = catch_unwind(AssertUnwindSafe(work));
    INSIDE.fetch_sub(1, Ordering::Relaxed);
    let answer = answer.unwrap_or_else(|panic| Err(format!("its library panicked: {}", told(&*panic)).into()));
    answer.map_err(|source| EngineError { engine: engine.to_owned(), source })
}

/// What a panic says.
fn told(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("it gives no reason")
}

#[cfg(test)]
mod tests {
    use super::unpanicked;

    #[test]
    fn a_panic_of_a_library_is_an_error() {
        let error = unpanicked("x", || -> Result<(), _> { panic!("index {} is out of range", 7) }).unwrap_err();
        assert_eq!(error.to_string(), "the engine x failed: its library panicked: index 7 is out of range");
    }
}
