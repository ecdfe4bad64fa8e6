//! What a sonar hears: a cone of rays, mirrors, corners, and other sonars.
//!
//! A transducer sends a cone of sound and measures when the first echo comes that is loud enough. Sound of 50 kHz is 7 mm
//! long, so walls are mirrors to it, but for angles near their normal (Kuc and Siegel 1987; Leonard and Durrant-Whyte 1992):
//!
//! * A **wall** that a ray meets within the *critical incidence* answers. Beyond it mirrors the ray away.
//! * What was **mirrored** may meet a second wall steeply enough; it then comes back by the same way, and seems to lie
//!   straight ahead, too far. Or it never comes back.
//! * **Corners** send it back whatever the angle, **edges** a little of it ([`crate::corners`]).
//! * **People** answer from every side, and no mirror shows what is behind them.
//! * Another sonar's sound counts as an own echo: **crosstalk**.
//!
//! An echo of strength s (1: a wall) at an angle φ off the axis and a distance d is loud enough if
//!
//! ```text
//! s exp(−φ²/(2 σ²)) ≥ h d/r_max          h = 0.1, σ = β/2 / √(2 ln 10)
//! ```
//!
//! so that a wall is just heard at the rim of the cone at the farthest range. (The amplifier makes up for most of what
//! distance costs, up to the range to which the sonar listens. Beyond, h grows by 3 dB per metre besides.)

use echogrid_core::noise::Draws;
use echogrid_core::{Cone, Echo, Fan, Meeting, Pose2, Reading, Transducer, Vicinity, World};

use crate::cause::{Cause, Heard};
use crate::config::SimulatorConfig;
use crate::corners::Corner;
use crate::people::{Disc, nearest_m};

/// h: what must come back of the sound, at the farthest range, to be heard.
const HEARING: f64 = 0.1;
/// What is left of the sound after a mirror; it passes each twice.
const MIRROR: f64 = 0.8;
const PERSON_STRENGTH: f64 = 0.6;
/// Of air at 50 kHz: 1.5 dB per metre, there and back, per metre of range.
const ABSORPTION_PER_M: f64 = 0.345;
/// Metres per second.
pub(crate) const SPEED_OF_SOUND: f64 = 343.0;
/// A mirrored ray starts so far off the mirror that it does not meet it again, metres.
const OFF_M: f64 = 1e-6;
/// A corner is seen if nothing stands nearer than so far before it, metres.
const BEFORE_CORNER_M: f64 = 0.01;
/// Of another sonar's cone, every so many rays are followed.
const CROSSTALK_STRIDE: usize = 3;

/// What all sonars share.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Acoustics {
    cos_critical: f64,
    bounces: u8,
}

impl Acoustics {
    pub(crate) fn new(config: &SimulatorConfig) -> Self {
        let critical_rad = config.critical_incidence_deg * core::f64::consts::PI / 180.0;
        // Head-on is head-on also at an angle of 0, but for rounding.
        Self { cos_critical: libm::cos(critical_rad) - 1e-12, bounces: config.bounces }
    }
}

/// What there is to hear at a moment.
#[derive(Clone, Copy)]
pub(crate) struct Scene<'a> {
    pub(crate) world: &'a World,
    /// What of the world is near the robot.
    pub(crate) vicinity: &'a Vicinity,
    pub(crate) corners: &'a [Corner],
    pub(crate) people: &'a [Disc],
}

/// A sonar, ready to be heard.
#[derive(Debug, Clone)]
pub(crate) struct Sonar {
    pub(crate) number: u16,
    transducer: Transducer,
    /// Cosine and sine of each ray's angle off the axis, and what the cone lets through there, both ways. The axis is
    /// first, then outwards: an early echo spares the rest.
    rays: Vec<Ray>,
    cos_half: f64,
    cone: Cone,
    /// 1/(2 σ²), 1/rad².
    falloff: f64,
    /// What another sonar's wall may be away and still be heard, metres.
    audible_m: f64,
}

#[derive(Debug, Clone, Copy)]
struct Ray {
    cos: f64,
    sin: f64,
    gain: f64,
}

/// Where a sonar is in the world, with cosine and sine of its heading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SonarPose {
    at: [f64; 2],
    axis: [f64; 2],
}

/// An echo that is loud enough.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Found {
    range_m: f64,
    cause: Cause,
}

/// A ray that was mirrored away.
#[derive(Debug, Clone, Copy)]
struct Mirrored {
    at: [f64; 2],
    direction: [f64; 2],
    /// Way so far.
    way_m: f64,
    strength: f64,
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

fn rotated([x, y]: [f64; 2], cos: f64, sin: f64) -> [f64; 2] {
    [x * cos - y * sin, y * cos + x * sin]
}

impl Mirrored {
    fn new(origin: [f64; 2], direction: [f64; 2], meeting: Meeting, way_m: f64, strength: f64) -> Self {
        let Meeting { distance_m, normal } = meeting;
        let across = 2.0 * dot(direction, normal);
        Self {
            at: [
                origin[0] + distance_m * direction[0] + OFF_M * normal[0],
                origin[1] + distance_m * direction[1] + OFF_M * normal[1],
            ],
            direction: [direction[0] - across * normal[0], direction[1] - across * normal[1]],
            way_m: way_m + distance_m,
            strength: strength * MIRROR * MIRROR,
        }
    }
}

impl Sonar {
    pub(crate) fn new(number: u16, transducer: Transducer, rays: u16) -> Self {
        let half_rad = 0.5 * transducer.aperture_rad;
        // exp(−φ²/(2 σ²)) = 1/10 at the rim.
        let falloff = core::f64::consts::LN_10 / (half_rad * half_rad);
        let ray = |angle_rad: f64| {
            let (sin, cos) = libm::sincos(angle_rad);
            Ray { cos, sin, gain: libm::exp(-falloff * angle_rad * angle_rad) }
        };
        let step_rad = if rays > 1 { transducer.aperture_rad / f64::from(rays - 1) } else { 0.0 };
        let mut angles: Vec<f64> =
            (0..rays).map(|index| (f64::from(index) - 0.5 * f64::from(rays - 1)) * step_rad).collect();
        angles.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
        let mut audible_m = transducer.range_max_m;
        while threshold(audible_m, transducer.range_max_m) < 1.0 {
            audible_m += 0.1;
        }
        Self {
            number,
            transducer,
            rays: angles.into_iter().map(ray).collect(),
            cos_half: libm::cos(half_rad),
            cone: Cone::new(half_rad),
            falloff,
            audible_m,
        }
    }

    pub(crate) fn range_max_m(&self) -> f64 {
        self.transducer.range_max_m
    }

    /// How far a wall may be and still be heard by others.
    pub(crate) fn audible_m(&self) -> f64 {
        self.audible_m
    }

    /// From no farther it hears anything, be it of another sonar whose sound set out `late_m` earlier: from the middle of
    /// the robot, metres.
    pub(crate) fn reach_m(&self, late_m: f64) -> f64 {
        let Pose2 { x, y, .. } = self.transducer.base_from_transducer;
        libm::hypot(x, y) + self.range_max_m().max(self.farthest_m(self.range_max_m(), late_m))
    }

    /// So far another's rays are followed, for an echo that seems to be nearer than `limit_m`.
    fn farthest_m(&self, limit_m: f64, late_m: f64) -> f64 {
        // The sonars are a hand apart: no more.
        (limit_m + late_m + 1.0).min(self.audible_m)
    }

    fn fan<'a>(&self, scene: &Scene<'a>, place: SonarPose, max_m: f64) -> Fan<'a> {
        Fan::new(scene.world, scene.vicinity, place.at, place.axis, &self.cone, max_m)
    }

    /// Whether the cones of two sonars have a direction in common.
    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        let (a, b) = (self.transducer, other.transducer);
        let apart = echogrid_core::wrap_angle(a.base_from_transducer.theta - b.base_from_transducer.theta);
        apart.abs() < 0.5 * (a.aperture_rad + b.aperture_rad)
    }

    pub(crate) fn place(&self, map_from_base: Pose2) -> SonarPose {
        let Pose2 { x, y, theta } = map_from_base * self.transducer.base_from_transducer;
        let (sin, cos) = libm::sincos(theta);
        SonarPose { at: [x, y], axis: [cos, sin] }
    }

    fn gain(&self, axis: [f64; 2], direction: [f64; 2]) -> f64 {
        let (cos, sin) = (dot(axis, direction), axis[0] * direction[1] - axis[1] * direction[0]);
        let angle = libm::atan2(sin, cos);
        libm::exp(-self.falloff * angle * angle)
    }

    /// Whether an echo of this strength is loud enough.
    fn hears(&self, strength: f64, range_m: f64) -> bool {
        strength >= threshold(range_m, self.transducer.range_max_m)
    }

    /// What it hears of itself and of others, whose sound set out `late_m` metres of range ago, from these places.
    pub(crate) fn listen(
        &self,
        acoustics: &Acoustics,
        scene: &Scene<'_>,
        place: SonarPose,
        others: &[(&Self, SonarPose, f64)],
        draws: &mut Draws,
    ) -> (Reading, Heard) {
        let (mut best, ahead) = self.own(acoustics, scene, place);
        for (other, other_place, late_m) in others {
            let limit_m = best.map_or(self.transducer.range_max_m, |best| best.range_m);
            if let Some(range_m) = self.crosstalk(acoustics, scene, place, other, *other_place, *late_m, limit_m) {
                best = Some(Found { range_m, cause: Cause::Crosstalk });
            }
        }
        let (echo, cause) = match best {
            None => (Echo::NoEcho, Cause::Nothing),
            // The transducer still rings.
            Some(Found { range_m, cause }) if range_m < self.transducer.range_min_m => (Echo::Invalid, cause),
            Some(Found { range_m, cause }) => {
                let range_m = range_m * (1.0 + self.transducer.range_error_ratio * draws.normal());
                if range_m > self.transducer.range_max_m {
                    (Echo::NoEcho, Cause::Nothing)
                } else if range_m < self.transducer.range_min_m || range_m <= 0.0 {
                    (Echo::Invalid, cause)
                } else {
                    (Echo::Hit { range_m }, cause)
                }
            }
        };
        let incidence_rad = ahead.map_or(0.0, |meeting| libm::acos((-dot(meeting.normal, place.axis)).clamp(0.0, 1.0)));
        let ahead_m = ahead.map(|meeting| meeting.distance_m);
        let heard = Heard { transducer: self.number, echo, cause, ahead_m, incidence_rad };
        (Reading { transducer: self.number, echo, offset_ns: 0 }, heard)
    }

    /// The nearest echo of its own sound that it hears, and what its axis meets.
    fn own(&self, acoustics: &Acoustics, scene: &Scene<'_>, place: SonarPose) -> (Option<Found>, Option<Meeting>) {
        let range_max_m = self.transducer.range_max_m;
        let mut best: Option<Found> = None;
        let mut limit_m = range_max_m;
        let mut mirrored: Vec<Mirrored> = Vec::new();
        let mut ahead = None;
        let fan = self.fan(scene, place, range_max_m);
        for (index, ray) in self.rays.iter().enumerate() {
            let direction = rotated(place.axis, ray.cos, ray.sin);
            let meeting = fan.meet(direction, limit_m);
            if index == 0 {
                ahead = meeting;
            }
            if !scene.people.is_empty() {
                let person_m = nearest_m(scene.people, place.at, direction);
                if person_m < meeting.map_or(limit_m, |meeting| meeting.distance_m) {
                    if self.hears(ray.gain * PERSON_STRENGTH, person_m) {
                        best = Some(Found { range_m: person_m, cause: Cause::Person });
                        limit_m = person_m;
                    }
                    continue;
                }
            }
            let Some(meeting) = meeting else { continue };
            if -dot(direction, meeting.normal) < acoustics.cos_critical {
                mirrored.push(Mirrored::new(place.at, direction, meeting, 0.0, ray.gain));
            } else if meeting.distance_m < limit_m && self.hears(ray.gain, meeting.distance_m) {
                best = Some(Found { range_m: meeting.distance_m, cause: Cause::Direct });
                limit_m = meeting.distance_m;
            }
        }
        if let Some(found) = self.corner(scene, &fan, place, limit_m) {
            limit_m = found.range_m;
            best = Some(found);
        }
        if acoustics.bounces > 0 {
            for next in mirrored {
                if let Some(range_m) = self.around(acoustics, scene, next, limit_m) {
                    limit_m = range_m;
                    best = Some(Found { range_m, cause: Cause::Multipath });
                }
            }
        }
        (best, ahead)
    }

    /// The nearest corner that it hears, nearer than `limit_m`.
    fn corner(&self, scene: &Scene<'_>, fan: &Fan<'_>, place: SonarPose, limit_m: f64) -> Option<Found> {
        let mut best: Option<Found> = None;
        for corner in scene.corners {
            let there = [corner.at[0] - place.at[0], corner.at[1] - place.at[1]];
            let nearest_m = best.map_or(limit_m, |best| best.range_m);
            let square = dot(there, there);
            if square >= nearest_m * nearest_m || square == 0.0 {
                continue;
            }
            let range_m = square.sqrt();
            let direction = [there[0] / range_m, there[1] / range_m];
            if dot(direction, place.axis) < self.cos_half
                || !corner.faces(place.at)
                || !self.hears(corner.strength * self.gain(place.axis, direction), range_m)
            {
                continue;
            }
            let before_m = range_m - BEFORE_CORNER_M;
            if nearest_person_m(scene.people, place.at, direction) > before_m && fan.meet(direction, before_m).is_none()
            {
                let cause = if corner.is_edge { Cause::Edge } else { Cause::Corner };
                best = Some(Found { range_m, cause });
            }
        }
        best
    }

    /// How far away what a mirrored ray comes back from seems to be, if that is nearer than `limit_m`.
    fn around(&self, acoustics: &Acoustics, scene: &Scene<'_>, from: Mirrored, limit_m: f64) -> Option<f64> {
        let mut ray = from;
        for _ in 0..acoustics.bounces {
            // Farther away it would be too faint: no need to look there.
            let left_m = limit_m.min(ray.strength * self.transducer.range_max_m / HEARING) - ray.way_m;
            if left_m <= 0.0 {
                return None;
            }
            let meeting = scene.world.meet(ray.at, ray.direction, left_m);
            let person_m = nearest_person_m(scene.people, ray.at, ray.direction);
            if person_m < meeting.map_or(left_m, |meeting| meeting.distance_m) {
                let range_m = ray.way_m + person_m;
                return self.hears(ray.strength * PERSON_STRENGTH, range_m).then_some(range_m);
            }
            let meeting = meeting?;
            if -dot(ray.direction, meeting.normal) >= acoustics.cos_critical {
                let range_m = ray.way_m + meeting.distance_m;
                return (range_m < limit_m && self.hears(ray.strength, range_m)).then_some(range_m);
            }
            ray = Mirrored::new(ray.at, ray.direction, meeting, ray.way_m, ray.strength);
        }
        None
    }

    /// How far away the echo of another sonar's sound seems to be, if that is nearer than `limit_m`. The other's sound set
    /// out earlier, by the time that it takes to come back from `late_m`.
    ///
    /// Of the other's rays those count that this one's cone hears too: an echo that comes back to the other comes back
    /// to its neighbour as well, its last leg from the same spot.
    #[expect(clippy::too_many_arguments, reason = "two sonars, each somewhere")]
    fn crosstalk(
        &self,
        acoustics: &Acoustics,
        scene: &Scene<'_>,
        place: SonarPose,
        other: &Self,
        other_place: SonarPose,
        late_m: f64,
        limit_m: f64,
    ) -> Option<f64> {
        let mut nearest_m = None;
        let mut limit_m = limit_m;
        let fan = other.fan(scene, other_place, other.farthest_m(limit_m, late_m));
        for ray in other.rays.iter().step_by(CROSSTALK_STRIDE) {
            let direction = rotated(other_place.axis, ray.cos, ray.sin);
            if dot(direction, place.axis) < self.cos_half {
                continue;
            }
            let farthest_m = other.farthest_m(limit_m, late_m);
            let Some(meeting) = fan.meet(direction, farthest_m) else { continue };
            if nearest_person_m(scene.people, other_place.at, direction) < meeting.distance_m {
                continue;
            }
            let (spot, range_m) = if -dot(direction, meeting.normal) >= acoustics.cos_critical {
                (along(other_place.at, direction, meeting.distance_m), meeting.distance_m)
            } else {
                let next = Mirrored::new(other_place.at, direction, meeting, 0.0, ray.gain);
                match self.around(acoustics, scene, next, farthest_m) {
                    Some(range_m) => (next.at, range_m),
                    None => continue,
                }
            };
            let back = [spot[0] - place.at[0], spot[1] - place.at[1]];
            let back_m = dot(back, back).sqrt();
            let arrives = [back[0] / back_m, back[1] / back_m];
            if dot(arrives, place.axis) < self.cos_half {
                continue;
            }
            let first_m = libm::hypot(spot[0] - other_place.at[0], spot[1] - other_place.at[1]);
            // One way each: the geometric mean of both.
            let gain = (ray.gain * self.gain(place.axis, arrives)).sqrt();
            let way_m = range_m + 0.5 * (back_m - first_m);
            let seems_m = way_m - late_m;
            if seems_m > 0.0 && seems_m < limit_m && self.hears(gain, way_m) {
                limit_m = seems_m;
                nearest_m = Some(seems_m);
            }
        }
        nearest_m
    }
}

fn along(origin: [f64; 2], direction: [f64; 2], way_m: f64) -> [f64; 2] {
    [origin[0] + way_m * direction[0], origin[1] + way_m * direction[1]]
}

fn nearest_person_m(people: &[Disc], origin: [f64; 2], direction: [f64; 2]) -> f64 {
    if people.is_empty() { f64::INFINITY } else { nearest_m(people, origin, direction) }
}

/// What must come back of the sound to be heard, from so far.
fn threshold(range_m: f64, range_max_m: f64) -> f64 {
    let within = HEARING * range_m / range_max_m;
    if range_m <= range_max_m { within } else { within * libm::exp(ABSORPTION_PER_M * (range_m - range_max_m)) }
}
