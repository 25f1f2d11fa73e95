//! What an import found: what could not be carried over, and what has another meaning.

use telltale_yaml::Problem;

/// Findings beyond this many are counted, not kept.
const FINDINGS_MAX: usize = 1000;

#[derive(Debug, Default)]
pub(super) struct Findings {
    list: Vec<Problem>,
    lost: usize,
}

impl Findings {
    /// Something could not be carried over.
    pub fn lost(&mut self, problem: Problem) {
        self.lost += 1;
        self.keep(problem);
    }

    /// Something means another thing here.
    pub fn differs(&mut self, problem: Problem) {
        self.keep(problem.as_warning());
    }

    fn keep(&mut self, problem: Problem) {
        if self.list.len() < FINDINGS_MAX {
            self.list.push(problem);
        }
    }

    pub fn count(&self) -> usize {
        self.lost
    }

    pub fn into_problems(self) -> Vec<Problem> {
        self.list
    }
}
