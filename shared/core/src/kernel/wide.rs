//! How many cells this processor computes at once, found out when the program runs.

use super::lanes::{Lanes, Portable};
#[cfg(target_arch = "x86_64")]
use super::x86::{Avx2, Avx512};

/// Something to be computed, whatever the number of lanes.
pub(super) trait Work {
    /// Does it. All that it calls must be inlined into it, to be compiled for the same processor.
    fn run<L: Lanes>(self);
}

/// What the processor has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Width {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Width {
    /// The most that there is.
    pub(super) fn of_this_processor() -> Self {
        Self::all().last().copied().unwrap_or(Self::Portable)
    }

    /// All that there is, narrow to wide.
    #[cfg(not(target_arch = "x86_64"))]
    pub(super) fn all() -> Vec<Self> {
        vec![Self::Portable]
    }

    /// All that there is, narrow to wide.
    #[cfg(target_arch = "x86_64")]
    pub(super) fn all() -> Vec<Self> {
        use std::arch::is_x86_feature_detected as has;
        let mut all = vec![Self::Portable];
        let avx2 = has!("avx2") && has!("fma") && has!("bmi1") && has!("bmi2") && has!("popcnt");
        if avx2 {
            all.push(Self::Avx2);
        }
        if avx2 && has!("avx512f") && has!("avx512vl") && has!("avx512dq") && has!("avx512bw") {
            all.push(Self::Avx512);
        }
        all
    }

    /// Does `work` with as many lanes.
    pub(super) fn run(self, work: impl Work) {
        match self {
            Self::Portable => work.run::<Portable>(),
            // SAFETY: `all`, which makes these, has asked the processor.
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { run_avx2(work) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => unsafe { run_avx512(work) },
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,popcnt")]
fn run_avx2(work: impl Work) {
    work.run::<Avx2>();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,popcnt,avx512f,avx512vl,avx512dq,avx512bw")]
fn run_avx512(work: impl Work) {
    work.run::<Avx512>();
}
