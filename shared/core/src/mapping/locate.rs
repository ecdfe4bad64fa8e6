//! A reading with all that must be known of it before it can be fused.

use crate::filter::{Channel, range_of};
use crate::fusion::Sounding;
use crate::odometry::Estimate;
use crate::reading::Reading;
use crate::verdict::Verdict;

/// A reading with its transducer, its range and where the robot was.
///
/// # Errors
/// The verdict on one that lacks them.
pub(crate) fn locate<'a>(
    channels: &'a [Option<Channel>],
    sequence: u64,
    reading: &'a Reading,
    estimate: Option<&'a Estimate>,
) -> Result<Sounding<'a>, Verdict> {
    let channel = channel_of(channels, reading.transducer).ok_or(Verdict::Invalid)?;
    let range_m = match range_of(reading.echo) {
        Err(Verdict::NoEcho) => None,
        heard => Some(heard?),
    };
    let estimate = estimate.filter(|estimate| estimate.pose.is_finite()).ok_or(Verdict::NoPose)?;
    Ok(Sounding { sequence, reading, channel, range_m, estimate })
}

/// A transducer that the robot has.
pub(super) fn channel_of(channels: &[Option<Channel>], transducer: u16) -> Option<&Channel> {
    channels.get(usize::from(transducer))?.as_ref()
}
