//! What contacts take their modes from, and how wrong these were.

/// How good the solution is that contacts take their modes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Solution {
    /// On the way: it tells what presses from what does not, and what has a limit waits for the end. It only says how
    /// wrong the modes are; they stay.
    Trial,
    /// The same, and the modes change.
    Rough,
    /// Solved to the tolerance.
    Final,
    /// The same, where contacts have changed for long enough: from now on they only let go, which ends.
    LettingGo,
}

impl Solution {
    /// Whether it is solved to the tolerance.
    #[must_use]
    pub fn is_solved(self) -> bool {
        matches!(self, Self::Final | Self::LettingGo)
    }
}

/// What contacts did in a solve against what its solution says that they should have done: sums of the squares of the
/// impulses that are wrong. Like a residual, it need not be zero.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Misjudged {
    /// All of it, N^2 s^2.
    all: f64,
    /// Of contacts that did too much: that pulled, or pushed by more than their limit, N^2 s^2.
    too_much: f64,
    /// Whether one of them holds or gives: its force is what the solve is for.
    beyond_doubt: bool,
}

impl Misjudged {
    /// One contact, by an impulse, N s.
    #[must_use]
    pub fn by(impulse_n_s: f64) -> Self {
        Self { all: impulse_n_s * impulse_n_s, ..Self::default() }
    }

    /// One contact that did too much by an impulse, N s.
    #[must_use]
    pub fn too_much(impulse_n_s: f64) -> Self {
        Self { too_much: impulse_n_s * impulse_n_s, ..Self::by(impulse_n_s) }
    }

    /// The same of a contact that holds or gives.
    #[must_use]
    pub fn beyond_doubt(self) -> Self {
        Self { beyond_doubt: true, ..self }
    }

    /// Whether another solve would tell anything beyond impulses of the norm `tolerance_n_s`, N s.
    #[must_use]
    pub fn exceeds(self, tolerance_n_s: f64) -> bool {
        self.beyond_doubt || self.norm_n_s() > tolerance_n_s
    }

    /// Norm of the impulses, N s.
    #[must_use]
    pub fn norm_n_s(self) -> f64 {
        self.all.sqrt()
    }

    /// Norm of those of contacts that did too much, N s.
    #[must_use]
    pub fn too_much_n_s(self) -> f64 {
        self.too_much.sqrt()
    }
}

impl std::ops::AddAssign for Misjudged {
    fn add_assign(&mut self, other: Self) {
        self.all += other.all;
        self.too_much += other.too_much;
        self.beyond_doubt |= other.beyond_doubt;
    }
}
