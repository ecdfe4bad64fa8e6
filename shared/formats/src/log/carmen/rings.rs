//! Sonars as `SONAR` lines name them: by where they sit, which each line says.
//!
//! A robot may have several rings that fire in turn, or leave sonars out: a sonar is known again by its mount.

use echogrid_core::Pose2;
use echogrid_core::robot::SENSORS_MAX;

/// Mounts and apertures that differ by less are one sonar's, metres and radians.
const SAME: f64 = 2e-3;
/// No sonar sits as far from the robot's centre, metres …
const MOUNT_FAR_M: f64 = 3.0;
/// … or is written to look as far from ahead, radians: a turn and a little.
const TURN_MAX_RAD: f64 = 6.5;

/// One sonar.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sonar {
    pub(super) base_from_sonar: Pose2,
    pub(super) aperture_rad: f64,
}

impl Sonar {
    fn is(&self, other: &Self) -> bool {
        let (a, b) = (self.base_from_sonar, other.base_from_sonar);
        a.distance_m(b) < SAME
            && echogrid_core::wrap_angle(a.theta - b.theta).abs() < SAME
            && (self.aperture_rad - other.aperture_rad).abs() < SAME
    }
}

/// All sonars of a log, in the order in which they were first named.
#[derive(Debug, Clone, Default)]
pub(super) struct Rings {
    pub(super) sonars: Vec<Sonar>,
    /// There were more than can be told apart: none is added any more.
    is_full: bool,
    /// Readings in the largest line, and in all.
    pub(super) most: usize,
    pub(super) readings: u64,
    rings: u64,
}

impl Rings {
    /// Takes in the sonars of a line, unless they are too many.
    pub(super) fn add(&mut self, aperture_rad: f64, mounts: &[Pose2]) -> bool {
        let (_, new) = self.assign(aperture_rad, mounts);
        if mounts.len() > SENSORS_MAX {
            return false;
        }
        if !new.is_empty() {
            // Once some are left out none is added any more: a line is used when it is read if it was when it was surveyed.
            self.is_full |= self.sonars.len() + new.len() > SENSORS_MAX;
            if self.is_full {
                return false;
            }
            self.sonars.extend(new);
            self.rings += 1;
        }
        self.most = self.most.max(mounts.len());
        self.readings += mounts.len() as u64;
        true
    }

    /// The sonar of each mount, by its number; none if one of them is no sonar of these.
    pub(super) fn numbers(&self, aperture_rad: f64, mounts: &[Pose2]) -> Option<Vec<u16>> {
        let (numbers, new) = self.assign(aperture_rad, mounts);
        new.is_empty().then_some(numbers)
    }

    /// The sonar of each mount that is one of these, and those that are none.
    fn assign(&self, aperture_rad: f64, mounts: &[Pose2]) -> (Vec<u16>, Vec<Sonar>) {
        let mut free: Vec<(u16, &Sonar)> = (0..).zip(&self.sonars).collect();
        let (mut numbers, mut new) = (Vec::new(), Vec::new());
        for base_from_sonar in mounts {
            let sonar = Sonar { base_from_sonar: *base_from_sonar, aperture_rad };
            match free.iter().position(|(_, other)| other.is(&sonar)) {
                Some(place) => numbers.push(free.remove(place).0),
                None => new.push(sonar),
            }
        }
        (numbers, new)
    }

    /// What is odd about them, in words that follow the name of the message.
    pub(super) fn remarks(&self) -> Vec<String> {
        let most =
            |of: fn(&Pose2) -> f64| self.sonars.iter().map(|sonar| of(&sonar.base_from_sonar)).fold(0.0, f64::max);
        let far_m = most(|mount| libm::hypot(mount.x, mount.y));
        let turned_rad = most(|mount| mount.theta.abs());
        let others = (self.rings > 1)
            .then(|| format!("lines name other sonars than the first did: {} in all", self.sonars.len()));
        let far = (far_m > MOUNT_FAR_M)
            .then(|| format!("sonars sit up to {far_m:.1} m from the robot's centre, as written: are these millimetres or centimetres?"));
        let turned = (turned_rad > TURN_MAX_RAD)
            .then(|| format!("sonars look up to {turned_rad:.1} rad from ahead, as written: are these degrees?"));
        others.into_iter().chain(far).chain(turned).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sonars_are_known_by_their_mounts() {
        let mount = |n: u32| Pose2::new(0.1 * f64::from(n), 0.0, 0.0);
        let mut rings = Rings::default();
        assert!(rings.add(0.5, &[mount(0), mount(1), mount(1)]));
        assert!(rings.add(0.5, &[mount(2), mount(1)]));
        assert_eq!(rings.sonars.len(), 4);
        assert_eq!(rings.numbers(0.5, &[mount(1), mount(2), mount(1), mount(0)]), Some(vec![1, 3, 2, 0]));
        assert_eq!(rings.numbers(0.7, &[mount(1)]), None);
        let many: Vec<Pose2> = (0..400).map(mount).collect();
        assert!(!rings.add(0.5, &many));
        assert_eq!(rings.sonars.len(), 4);
        assert!(rings.add(0.5, &many[..200]));
        assert!(!rings.add(0.5, &many[200..399]), "they would be too many");
        assert!(!rings.add(0.5, &[mount(390)]), "none is added any more");
        assert!(rings.add(0.5, &[mount(199)]));
        assert_eq!(rings.sonars.len(), 201);
    }
}
