//! A ring of sonars: who fires when, and who hears whom.

use echogrid_core::noise::Draws;
use echogrid_core::{Pose2, Reading, Robot, SensorKind};

use crate::cause::Heard;
use crate::config::SimulatorConfig;
use crate::error::SimulatorError;
use crate::sonar::{Acoustics, SPEED_OF_SOUND, Scene, Sonar, SonarPose};

/// All sonars of a robot in their firing order.
#[derive(Debug, Clone)]
pub(crate) struct Ring {
    acoustics: Acoustics,
    /// In turn; those that fire together.
    slots: Vec<Vec<Firing>>,
    period_ns: u64,
    /// The slot that fires next.
    next: usize,
    /// Where those of the slot before were, as they fired.
    before: Vec<(usize, SonarPose)>,
    readings: Vec<Reading>,
    /// The truth about them.
    pub(crate) heard: Vec<Heard>,
    draws: Draws,
}

/// A sonar that fires, and whose sound it may hear besides its own.
#[derive(Debug, Clone)]
struct Firing {
    sonar: Sonar,
    /// Places in its own slot.
    together: Vec<usize>,
    /// Places in the slot before.
    before: Vec<usize>,
}

impl Ring {
    /// The ring of a robot; none if it has no sonar.
    pub(crate) fn new(config: &SimulatorConfig, robot: &Robot) -> Result<Option<Self>, SimulatorError> {
        let is_sonar = |number: &u16| robot.transducer(*number).is_some_and(|t| t.kind == SensorKind::Sonar);
        let count = u16::try_from(robot.transducer_count()).unwrap_or(u16::MAX);
        let all: Vec<u16> = (0..count).filter(is_sonar).collect();
        if let Some(number) = config.firing_order.iter().flatten().find(|number| !is_sonar(number)) {
            let has = match (all.first(), all.last()) {
                (Some(first), Some(last)) => format!("sonars {first} to {last}"),
                _ => "no sonar".to_owned(),
            };
            return Err(SimulatorError::NoSuchSonar { number: *number, robot: robot.name.clone(), has });
        }
        let order = if config.firing_order.is_empty() {
            all.into_iter().map(|number| vec![number]).collect()
        } else {
            config.firing_order.clone()
        };
        if order.is_empty() {
            return Ok(None);
        }
        let sonar = |number: u16| Some(Sonar::new(number, robot.transducer(number)?, config.rays));
        let sonars: Vec<Vec<Sonar>> =
            order.into_iter().map(|together| together.into_iter().filter_map(sonar).collect()).collect();
        let late_m = 0.5 * config.firing_period_s * SPEED_OF_SOUND;
        let heard_by = |hears: &Sonar, slot: &[Sonar], late_m: f64| -> Vec<usize> {
            let others = slot.iter().enumerate().filter(|(_, other)| {
                // What comes so late must still be audible.
                config.crosstalk && other.number != hears.number && hears.overlaps(other) && late_m < other.audible_m()
            });
            others.map(|(index, _)| index).collect()
        };
        let slots = (0..sonars.len()).map(|slot| {
            let earlier = &sonars[(slot + sonars.len() - 1) % sonars.len()];
            let fire = |sonar: &Sonar| Firing {
                together: heard_by(sonar, &sonars[slot], 0.0),
                before: if sonars.len() > 1 { heard_by(sonar, earlier, late_m) } else { Vec::new() },
                sonar: sonar.clone(),
            };
            sonars[slot].iter().map(fire).collect()
        });
        Ok(Some(Self {
            acoustics: Acoustics::new(config),
            slots: slots.collect(),
            period_ns: crate::nanoseconds(config.firing_period_s),
            next: 0,
            before: Vec::new(),
            readings: Vec::new(),
            heard: Vec::new(),
            draws: Draws::new(config.seed, "sonar"),
        }))
    }

    pub(crate) fn period_ns(&self) -> u64 {
        self.period_ns
    }

    /// The farthest range of any of them, metres.
    pub(crate) fn range_max_m(&self) -> f64 {
        self.slots.iter().flatten().map(|firing| firing.sonar.range_max_m()).fold(0.0, f64::max)
    }

    /// From no farther anything is heard, from the middle of the robot, metres.
    pub(crate) fn reach_m(&self) -> f64 {
        let late_m = self.late_m();
        self.slots.iter().flatten().map(|firing| firing.sonar.reach_m(late_m)).fold(0.0, f64::max)
    }

    /// The slot before fired so far away, metres of range.
    fn late_m(&self) -> f64 {
        0.5 * self.period_ns as f64 * 1e-9 * SPEED_OF_SOUND
    }

    /// When each sonar of the robot fires, nanoseconds after the stamp of its scan.
    pub(crate) fn offsets_ns(&self, robot: &Robot) -> Vec<i32> {
        let sonars = robot.sensors.iter().filter(|sensor| sensor.kind == SensorKind::Sonar);
        let offset = |number: u16| {
            let fires = |slot: &Vec<Firing>| slot.iter().any(|firing| firing.sonar.number == number);
            self.slots.iter().position(fires).map_or(0, |slot| self.offset_ns(slot))
        };
        sonars.map(|sensor| offset(sensor.first_transducer)).collect()
    }

    /// Of a slot, before the last one.
    fn offset_ns(&self, slot: usize) -> i32 {
        let before_ns = (self.slots.len() - 1 - slot) as u64 * self.period_ns;
        -i32::try_from(before_ns).unwrap_or(i32::MAX)
    }

    /// The next slot fires. After the last of the order: all readings of the round.
    pub(crate) fn fire(&mut self, scene: &Scene<'_>, map_from_base: Pose2) -> Option<Vec<Reading>> {
        if self.next == 0 {
            self.readings.clear();
            self.heard.clear();
        }
        let offset_ns = self.offset_ns(self.next);
        let slot = &self.slots[self.next];
        let earlier = &self.slots[(self.next + self.slots.len() - 1) % self.slots.len()];
        let late_m = self.late_m();
        let places: Vec<SonarPose> = slot.iter().map(|firing| firing.sonar.place(map_from_base)).collect();
        for (index, firing) in slot.iter().enumerate() {
            let together = firing.together.iter().map(|other| (&slot[*other].sonar, places[*other], 0.0));
            let before = self.before.iter().filter(|(other, _)| firing.before.contains(other));
            let before = before.map(|(other, place)| (&earlier[*other].sonar, *place, late_m));
            let others: Vec<_> = together.chain(before).collect();
            let (mut reading, heard) =
                firing.sonar.listen(&self.acoustics, scene, places[index], &others, &mut self.draws);
            reading.offset_ns = offset_ns;
            self.readings.push(reading);
            self.heard.push(heard);
        }
        self.before = places.into_iter().enumerate().collect();
        self.next = (self.next + 1) % self.slots.len();
        (self.next == 0).then(|| {
            // A scan is in the order of the transducers, as a log has it.
            self.readings.sort_by_key(|reading| reading.transducer);
            self.heard.sort_by_key(|heard| heard.transducer);
            self.readings.clone()
        })
    }
}
