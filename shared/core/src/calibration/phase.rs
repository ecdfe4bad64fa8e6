//! The trials of one phase, as what is fitted to them needs them.

use super::Trial;

/// The trials of a phase: what was measured along its own axis, and the errors of both axes.
#[derive(Debug, Clone, Default)]
pub(super) struct Phase {
    pub(super) trials: Vec<Sample>,
}

/// One trial. Of a translation x and own are metres and other is radians; of a rotation the other way round.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Sample {
    /// The displacement that was measured, with its sign.
    pub(super) x: f64,
    /// The error of that displacement.
    pub(super) own: f64,
    /// The error of the other one.
    pub(super) other: f64,
}

/// What one phase tells of the model.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Shares {
    /// Slope through the origin of own over x.
    pub(super) scale: f64,
    /// Mean of other.
    pub(super) offset: f64,
    /// Variance of what the slope leaves of own, per mean |x|.
    pub(super) k_own: f64,
    /// Variance of other, per mean |x|.
    pub(super) k_other: f64,
}

impl Shares {
    pub(super) const COUNT: usize = 4;

    pub(super) fn as_array(self) -> [f64; Self::COUNT] {
        [self.scale, self.offset, self.k_own, self.k_other]
    }

    pub(super) fn from_array([scale, offset, k_own, k_other]: [f64; Self::COUNT]) -> Self {
        Self { scale, offset, k_own, k_other }
    }
}

impl Phase {
    pub(super) fn translation(trials: &[Trial]) -> Self {
        let sample = |t: &Trial| Sample { x: t.measured_m, own: t.lin_error_m(), other: t.ang_error_rad() };
        Self { trials: trials.iter().map(sample).collect() }
    }

    pub(super) fn rotation(trials: &[Trial]) -> Self {
        let sample = |t: &Trial| Sample { x: t.measured_rad, own: t.ang_error_rad(), other: t.lin_error_m() };
        Self { trials: trials.iter().map(sample).collect() }
    }

    /// Not finite where nothing was measured along the axis.
    pub(super) fn shares(&self) -> Shares {
        let way = self.mean(|s| s.x.abs());
        let sum = |value: fn(&Sample) -> f64| self.trials.iter().map(value).sum::<f64>();
        let scale = sum(|s| s.x * s.own) / sum(|s| s.x * s.x);
        Shares {
            scale,
            offset: self.mean(|s| s.other),
            k_own: self.variance(|s| s.own - scale * s.x) / way,
            k_other: self.variance(|s| s.other) / way,
        }
    }

    /// How much each trial moves each of the shares, to a common factor.
    pub(super) fn influences(&self) -> impl Iterator<Item = [f64; Shares::COUNT]> + '_ {
        let Shares { scale, offset, k_own, k_other } = self.shares();
        let way = self.mean(|s| s.x.abs());
        let middle = self.mean(|s| s.own - scale * s.x);
        self.trials.iter().map(move |s| {
            let left = s.own - scale * s.x;
            let longer = s.x.abs() - way;
            let square = |value: f64| value * value;
            [
                s.x * left,
                s.other - offset,
                square(left - middle) - k_own * way - k_own * longer,
                square(s.other - offset) - k_other * way - k_other * longer,
            ]
        })
    }

    fn mean(&self, value: impl Fn(&Sample) -> f64) -> f64 {
        self.trials.iter().map(value).sum::<f64>() / self.trials.len() as f64
    }

    fn variance(&self, value: impl Fn(&Sample) -> f64) -> f64 {
        let middle = self.mean(&value);
        let square = |sample: &Sample| (value(sample) - middle) * (value(sample) - middle);
        self.trials.iter().map(square).sum::<f64>() / (self.trials.len() - 1) as f64
    }
}
