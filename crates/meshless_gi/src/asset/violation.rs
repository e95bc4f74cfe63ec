//! Violations that a validation finds, and their list.

use std::fmt;

/// Largest number of violations that are listed.
const MAX_VIOLATIONS: usize = 32;

/// Violation of one condition.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Violation {
    /// Name of the array or field.
    pub location: &'static str,
    /// Index of the item. `None` if the field is not an array.
    pub index: Option<usize>,
    /// Problem.
    pub problem: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.index {
            Some(i) => write!(f, "{}[{i}]: {}", self.location, self.problem),
            None => write!(f, "{}: {}", self.location, self.problem),
        }
    }
}

/// Collector of violations.
pub(super) struct Check(pub(super) Vec<Violation>);

impl Check {
    pub(super) fn is_full(&self) -> bool {
        self.0.len() >= MAX_VIOLATIONS
    }

    pub(super) fn item(
        &mut self,
        ok: bool,
        location: &'static str,
        index: usize,
        problem: impl FnOnce() -> String,
    ) {
        if !ok && !self.is_full() {
            self.0.push(Violation {
                location,
                index: Some(index),
                problem: problem(),
            });
        }
    }

    pub(super) fn section(
        &mut self,
        ok: bool,
        location: &'static str,
        problem: impl FnOnce() -> String,
    ) {
        if !ok && !self.is_full() {
            self.0.push(Violation {
                location,
                index: None,
                problem: problem(),
            });
        }
    }
}
