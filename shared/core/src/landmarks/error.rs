//! Why a pose could not be had from sightings.

/// Why the place of the landmarks leaves the pose open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Degeneracy {
    /// The robot and all landmarks are on one line: nothing holds the robot across it (ranges) or along it (bearings).
    OneLine,
    /// The robot and all landmarks are on one circle: from everywhere on it the bearings differ by the same angles.
    OneCircle,
    /// The landmarks lie too close to each other, as seen from the robot, for measurements this uncertain.
    Weak,
}

impl core::fmt::Display for Degeneracy {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::OneLine => {
                "the robot and the landmarks lie on one line (or nearly so); sight a landmark well off that line"
            }
            Self::OneCircle => {
                "the robot and the landmarks lie on one circle (or nearly so), from everywhere on which the bearings differ by \
                 the same angles; sight a landmark well off that circle, or measure a range"
            }
            Self::Weak => {
                "as seen from the robot the landmarks lie too close together for measurements this uncertain; sight landmarks in \
                 other directions"
            }
        })
    }
}

/// Why a pose could not be had from sightings. Sightings are counted from 0 in fields, from 1 in words.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TriangulationError {
    /// A number of a sighting is not finite or not possible.
    #[error("sighting {}: the {what} is {value}; expected {expected}", sighting + 1)]
    BadValue {
        /// Index of the sighting.
        sighting: usize,
        /// Which number.
        what: &'static str,
        /// What it is.
        value: f64,
        /// What would have been right.
        expected: &'static str,
    },
    /// A sighting has neither range nor bearing.
    #[error("sighting {}: nothing was measured; expected a range, a bearing or both", sighting + 1)]
    NothingMeasured {
        /// Index of the sighting.
        sighting: usize,
    },
    /// A number of the guess is not finite or not possible.
    #[error("the guess of the pose has {value} in it; expected {expected}")]
    BadGuess {
        /// What it is.
        value: f64,
        /// What would have been right.
        expected: &'static str,
    },
    /// More than [`SIGHTINGS_MAX`](super::SIGHTINGS_MAX) sightings.
    #[error("{count} sightings; expected at most {}", super::SIGHTINGS_MAX)]
    TooMany {
        /// How many.
        count: usize,
    },
    /// Not enough measurements of different landmarks.
    #[error("{}", too_few(*ranges, *bearings, *missing))]
    TooFew {
        /// Landmarks at different places whose range was measured.
        ranges: usize,
        /// Landmarks at different places whose bearing was measured.
        bearings: usize,
        /// Measurements to further landmarks that are needed at least.
        missing: usize,
    },
    /// Every sighting is of the same place.
    #[error(
        "all {count} sightings are of landmarks at one and the same place, which leaves open from where it was seen; sight a \
         landmark elsewhere"
    )]
    OnePlace {
        /// How many sightings.
        count: usize,
    },
    /// The place of the landmarks leaves the pose open.
    #[error("{geometry}{}", uncertainty(*position_sigma_m, *distance_m))]
    Degenerate {
        /// What is wrong with it.
        geometry: Degeneracy,
        /// Standard deviation that the position would have, metres (root of the sum of the variances of x and y); none where
        /// it has no bound.
        position_sigma_m: Option<f64>,
        /// How far the landmarks are: root mean square, metres.
        distance_m: f64,
    },
    /// Two places fit the sightings about equally well, and the guess is not clearly nearer to one of them.
    #[error(
        "two places fit the sightings: ({:.3}, {:.3}) and ({:.3}, {:.3}), and the guess is not clearly nearer to one of them; \
         sight a landmark off the line through the others, or guess better", places[0][0], places[0][1], places[1][0], places[1][1]
    )]
    Ambiguous {
        /// x, y in the map frame, metres; the one nearer to the guess first.
        places: [[f64; 2]; 2],
    },
    /// No pose fits the sightings as well as their standard deviations promise.
    #[error(
        "no pose fits the sightings: chi² is {chi2:.1}, expected below {limit:.1} ({degrees_of_freedom} degrees of freedom); sighting \
         {} is worst, off by {worst_sigmas:.1} sigma: is a landmark mistaken for another or surveyed wrongly, or is a sigma too \
         small?", worst + 1
    )]
    Inconsistent {
        /// Sum of the squared residuals over their variances, at the best pose there is.
        chi2: f64,
        /// What it may be.
        limit: f64,
        /// Measurements more than unknowns.
        degrees_of_freedom: usize,
        /// Index of the sighting that fits worst. With few sightings more than needed it need not be the one that is wrong.
        worst: usize,
        /// How badly: the larger of its residuals, in standard deviations.
        worst_sigmas: f64,
    },
    /// No best pose was found: the farther away the robot is put, the better everything fits.
    #[error(
        "the search for the pose led nowhere: the sightings fit the better, the farther away the robot is put; is a landmark \
         mistaken for another, or are bearings not counter-clockwise from straight ahead?"
    )]
    NoConvergence,
}

fn too_few(ranges: usize, bearings: usize, missing: usize) -> String {
    let plural = |count: usize, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
    let more = if bearings == 0 && ranges == 0 {
        "two ranges, or three bearings, to different landmarks are needed at least".to_owned()
    } else if bearings == 0 {
        // One range is there.
        "one more range is needed, to another landmark (for the position; the heading takes a bearing and one more)"
            .to_owned()
    } else {
        let landmark = if missing == 1 { "one more bearing or range" } else { "two more bearings or ranges" };
        format!("{landmark} to different landmarks {} needed", if missing == 1 { "is" } else { "are" })
    };
    format!(
        "{} and {} to different landmarks are too few: {more}",
        plural(ranges, "range"),
        plural(bearings, "bearing")
    )
}

fn uncertainty(position_sigma_m: Option<f64>, distance_m: f64) -> String {
    match position_sigma_m {
        Some(sigma) => {
            format!(" (the position would be known to {sigma:.2} m only, from landmarks {distance_m:.2} m away)")
        }
        None => String::new(),
    }
}
