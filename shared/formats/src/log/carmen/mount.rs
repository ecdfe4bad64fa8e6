//! Where the lasers of a log sit on the robot: what a parameter says, and what the poses in the lines say.

use echogrid_core::{Pose2, Sensor, wrap_angle};

use super::message::ScanKind;

/// A mount pose is taken from the poses in the messages if they agree to this, metres and radians.
const SAME_MOUNT: f64 = 0.01;
/// The poses in the lines contradict a parameter from here on, metres: nearer it may have been rounded.
const CONTRADICTS_M: f64 = 0.03;
/// A sensor sits no farther than this from the robot's base, metres.
const MOUNT_MAX_M: f64 = 3.0;

/// Where the messages' poses say the sensor sits.
#[derive(Debug, Clone, Copy)]
pub(super) enum Mount {
    Unsaid,
    Agreed(Pose2),
    Contradictory,
}

impl Mount {
    /// Takes note of where a line says it.
    pub(super) fn add(&mut self, base_from_sensor: Pose2) {
        *self = match *self {
            Self::Unsaid => Self::Agreed(base_from_sensor),
            Self::Agreed(first) if near(first, base_from_sensor, SAME_MOUNT) => Self::Agreed(first),
            Self::Agreed(_) | Self::Contradictory => Self::Contradictory,
        };
    }

    /// Where all lines say that it sits.
    fn seen(self) -> Option<Pose2> {
        match self {
            // Equal poses say nothing: corrected logs write the same pose twice.
            Self::Agreed(pose)
                if pose.distance_m(Pose2::IDENTITY) < MOUNT_MAX_M && !near(pose, Pose2::IDENTITY, 1e-6) =>
            {
                Some(pose)
            }
            _ => None,
        }
    }
}

fn near(a: Pose2, b: Pose2, tolerance: f64) -> bool {
    a.distance_m(b) < tolerance && wrap_angle(a.theta - b.theta).abs() < tolerance
}

/// The parameter that says how far ahead of the base a laser of this kind sits.
fn parameter(kind: ScanKind) -> Option<&'static str> {
    match kind {
        ScanKind::Front | ScanKind::Robot(1) | ScanKind::Raw(1) => Some("robot_frontlaser_offset"),
        ScanKind::Rear | ScanKind::Robot(2) | ScanKind::Raw(2) => Some("robot_rearlaser_offset"),
        _ => None,
    }
}

/// Where a laser sits: the log's parameter says it, unless the laser and robot poses of all messages agree on something else; else these
/// say it, else it sits on the base. A rear laser looks backwards, unless its heading is turned against the robot's in every line; so
/// does a front laser then. `number`: of a parameter.
pub(super) fn of_laser(kind: ScanKind, mount: Mount, number: &dyn Fn(&str) -> Option<f64>) -> Pose2 {
    let facing = match kind {
        ScanKind::Rear | ScanKind::Robot(2) | ScanKind::Raw(2) => core::f64::consts::PI,
        _ => 0.0,
    };
    let stated = parameter(kind).and_then(number).filter(|offset| offset.abs() < MOUNT_MAX_M);
    let seen = mount.seen();
    // The heading in FLASER and RLASER lines is the robot's, unless it is said to be another.
    let facing = seen.map(|pose| pose.theta).filter(|theta| theta.abs() > SAME_MOUNT).unwrap_or(facing);
    match (kind, stated, seen) {
        (ScanKind::Robot(_), _, Some(pose)) => pose,
        (_, Some(offset), Some(pose)) if contradicts(pose, offset) => Pose2::new(pose.x, pose.y, facing),
        (_, Some(offset), _) => Pose2::new(offset, 0.0, facing),
        (_, None, Some(pose)) => Pose2::new(pose.x, pose.y, facing),
        (_, None, None) => Pose2::new(0.0, 0.0, facing),
    }
}

/// Whether the poses of the lines say something else than the parameter.
fn contradicts(seen: Pose2, offset_m: f64) -> bool {
    seen.distance_m(Pose2::new(offset_m, 0.0, 0.0)) > CONTRADICTS_M
}

/// What is odd about where a laser sits, in words.
pub(super) fn remarks(
    kind: ScanKind,
    mount: Mount,
    sensor: Option<&Sensor>,
    number: &dyn Fn(&str) -> Option<f64>,
) -> Vec<String> {
    turned(kind, sensor).into_iter().chain(contradiction(kind, mount, number)).collect()
}

/// A parameter that does not say where the laser sits, in words.
fn contradiction(kind: ScanKind, mount: Mount, number: &dyn Fn(&str) -> Option<f64>) -> Option<String> {
    let name = parameter(kind)?;
    let offset = number(name)?;
    let (kind, seen) = (kind.name(), mount.seen());
    if offset.is_nan() || offset.abs() >= MOUNT_MAX_M {
        let taken = match seen {
            Some(pose) => format!("taken {:.2} m ahead of it, as the poses in its lines say", pose.x),
            None => "taken to sit on it".into(),
        };
        let meant = if offset.abs() < 100.0 * MOUNT_MAX_M {
            format!("; if centimetres were meant, PARAM {name} {} says so", offset / 100.0)
        } else if offset.abs() < 1000.0 * MOUNT_MAX_M {
            format!("; if millimetres were meant, PARAM {name} {} says so", offset / 1000.0)
        } else {
            String::new()
        };
        return Some(format!(
            "{kind}: no laser sits {offset} m from its robot's base, as PARAM {name} has it: it is {taken}{meant}"
        ));
    }
    let pose = seen.filter(|pose| contradicts(*pose, offset))?;
    Some(format!(
        "{kind}: PARAM {name} says {offset} m, the poses in all its lines say {:.2} m ahead and {:.2} m to the left: these count",
        pose.x, pose.y
    ))
}

/// A laser of `FLASER` or `RLASER` that does not look where these do, in words.
fn turned(kind: ScanKind, sensor: Option<&Sensor>) -> Option<String> {
    let usual = match kind {
        ScanKind::Front => 0.0,
        ScanKind::Rear => core::f64::consts::PI,
        _ => return None,
    };
    let heading = sensor?.base_from_sensor.theta;
    let is_turned = wrap_angle(heading - usual).abs() > SAME_MOUNT;
    // Half a turn has no sense of rotation.
    let degrees = if heading.abs() > core::f64::consts::PI - SAME_MOUNT { 180.0 } else { heading.to_degrees() };
    is_turned.then(|| {
        let off = format!("the laser's heading is {degrees:.1}° from the robot's in every line");
        format!("{}: {off}: it is mapped as turned by that", kind.name())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn agreed(x: f64) -> Mount {
        let mut mount = Mount::Unsaid;
        (0..3).for_each(|_| mount.add(Pose2::new(x, 0.0, 0.0)));
        mount
    }

    /// Where the laser is taken to sit, and what is said.
    fn front(parameter: Option<f64>, mount: Mount) -> (f64, Vec<String>) {
        let number = |name: &str| parameter.filter(|_| name == "robot_frontlaser_offset");
        let place = of_laser(ScanKind::Front, mount, &number);
        (place.x, remarks(ScanKind::Front, mount, None, &number))
    }

    #[test]
    fn the_parameter_says_it_unless_all_lines_say_something_else() {
        assert_eq!(front(Some(0.3), Mount::Unsaid), (0.3, vec![]));
        assert_eq!(front(Some(0.3), agreed(0.31)), (0.3, vec![]));
        assert_eq!(front(None, agreed(0.31)), (0.31, vec![]));
        let (x, said) = front(Some(-0.3), agreed(0.3));
        assert_eq!((x, said.len()), (0.3, 1));
        assert!(said[0].contains("PARAM robot_frontlaser_offset says -0.3 m"), "{said:?}");
    }

    #[test]
    fn a_parameter_that_is_no_place_on_a_robot_is_said() {
        let (x, said) = front(Some(30.0), agreed(0.3));
        assert!(
            x == 0.3 && said[0].contains("if centimetres were meant") && said[0].contains("0.30 m ahead"),
            "{said:?}"
        );
        let (x, said) = front(Some(300.0), Mount::Unsaid);
        assert!(x == 0.0 && said[0].contains("if millimetres were meant"), "{said:?}");
        assert_eq!(front(Some(1e9), Mount::Unsaid).1.len(), 1);
    }
}
