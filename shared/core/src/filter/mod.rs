//! What stands between a scan and the map: an ordered chain of filters (section 4.2 of the paper). Every reading leaves it
//! with a verdict.
//!
//! | filter | refuses | file |
//! |---|---|---|
//! | `range` | what is nearer or farther than a sensor can tell | [`range`] |
//! | `selection` | sonars that are not used | [`selection`] |
//! | `stuck` | sonars that lie for long, and the silence of those that hear hardly anything | [`stuck`], [`silent`] |
//! | `lone` | what one sonar hears and no other supports | [`lone`] |
//! | `bubble` | multiple reflections | [`bubble`] |
//!
//! The first two look at one reading, the others at the sonars of a whole scan and of the rings before it, in the map, by the
//! estimates. What an earlier filter refused is no witness in a later one. Lidars pass those: a beam has no cone to speak of.

mod bubble;
mod channel;
mod claim;
mod lone;
mod range;
mod ring;
mod selection;
mod silent;
mod stuck;
#[cfg(test)]
mod tests;

pub(crate) use channel::{Channel, channels};
use claim::Claim;
pub(crate) use range::range_of;
use ring::{Past, Ring};
use serde::{Deserialize, Serialize};
use silent::Hearing;
use stuck::Health;

use crate::config::{Filter, Fusion, MapperConfig, NoEcho};
use crate::odometry::Estimate;
use crate::reading::Reading;
use crate::robot::SensorKind;
use crate::verdict::Verdict;

/// A sonar is silent whose share of readings with an echo is less than this part of that of the middle one of all.
pub const SILENT_SHARE: f64 = 0.1;

/// What the filters remember from scan to scan.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Memory {
    past: Past,
    health: Health,
    hearing: Hearing,
}

/// The filters in their order, and what they remember.
#[derive(Debug, Clone)]
pub(crate) struct Chain {
    filters: Vec<Filter>,
    no_echo: NoEcho,
    fusion: Fusion,
    bubble_tolerance_m: f64,
    stuck_after_m: f64,
    ring: Ring,
    health: Health,
    hearing: Hearing,
}

impl Chain {
    /// As a valid configuration says.
    pub(crate) fn new(config: &MapperConfig, channels: &[Option<Channel>]) -> Self {
        let mut filters = config.filters.clone();
        if !lone::is_ring(sonars_before(Filter::Lone, &filters, channels)) {
            filters.retain(|filter| *filter != Filter::Lone);
        }
        Self {
            filters,
            no_echo: config.no_echo,
            fusion: config.fusion,
            bubble_tolerance_m: config.bubble_tolerance_m,
            stuck_after_m: config.stuck_after_m,
            ring: Ring::new(
                usize::from(config.filter_rings),
                usize::from(config.bubble_rings),
                config.lone_tolerance_m,
            ),
            health: Health::default(),
            hearing: Hearing::default(),
        }
    }

    /// All that what comes depends on, besides the configuration.
    pub(crate) fn memory(&self) -> Memory {
        Memory { past: self.ring.past.clone(), health: self.health.clone(), hearing: self.hearing.clone() }
    }

    /// What it remembered once, again.
    pub(crate) fn remember(&mut self, memory: Memory) {
        (self.ring.past, self.health, self.hearing) = (memory.past, memory.health, memory.hearing);
    }

    /// Why a single reading is refused, if it is, by the filters that look at no other.
    pub(crate) fn refusal(&self, channels: &[Option<Channel>], reading: &Reading) -> Option<Verdict> {
        let (channel, range_m) = match heard(channels, reading) {
            Ok(heard) => heard,
            Err(verdict) => return self.unless_it_clears(channels, reading, verdict),
        };
        self.filters.iter().find_map(|filter| alone(*filter, channel, range_m))
    }

    /// Why each reading of a scan is refused, if it is.
    pub(crate) fn judge(
        &mut self,
        channels: &[Option<Channel>],
        scan: &[(Reading, Option<Estimate>)],
    ) -> Vec<Option<Verdict>> {
        if self.filters.iter().all(|filter| filter.is_alone()) {
            return scan.iter().map(|(reading, _)| self.refusal(channels, reading)).collect();
        }
        let mut verdicts: Vec<Option<Verdict>> =
            scan.iter().map(|(reading, _)| heard(channels, reading).err()).collect();
        let claims = scan.iter().enumerate().filter_map(|(index, (reading, estimate))| {
            let (channel, range_m) = heard(channels, reading).ok()?;
            let estimate = estimate.as_ref().filter(|estimate| estimate.pose.is_finite())?;
            let sonar = &channel.transducer;
            let map_from_transducer = estimate.pose * sonar.base_from_transducer;
            let claim = Claim::new(reading.transducer, map_from_transducer, range_m, sonar.aperture_rad);
            (sonar.kind == SensorKind::Sonar).then_some((index, claim))
        });
        self.ring.begin(claims, scan.iter().find_map(|(_, estimate)| estimate.as_ref()));
        for filter in &self.filters {
            match filter {
                Filter::Range | Filter::Selection => {
                    for ((reading, _), verdict) in scan.iter().zip(&mut verdicts) {
                        let refusal =
                            || heard(channels, reading).map_or(None, |(c, range_m)| alone(*filter, c, range_m));
                        *verdict = verdict.or_else(refusal);
                    }
                    let refused = |(place, standing): (usize, &ring::Standing)| {
                        verdicts.get(standing.index).copied().flatten().map(|verdict| (place, verdict))
                    };
                    let refused: Vec<(usize, Verdict)> = self.ring.standing().filter_map(refused).collect();
                    refused.into_iter().for_each(|(place, verdict)| self.ring.refuse(&[place], verdict));
                }
                Filter::Stuck => self.health.judge(&mut self.ring, self.stuck_after_m),
                Filter::Lone => lone::judge(&mut self.ring),
                Filter::Bubble => bubble::judge(&mut self.ring, self.bubble_tolerance_m),
            }
        }
        self.ring.end();
        for standing in &self.ring.present {
            if let Some(verdict) = verdicts.get_mut(standing.index) {
                *verdict = verdict.or(standing.refusal);
            }
        }
        let silent = self.silent(channels, scan);
        for (verdict, (reading, _)) in verdicts.iter_mut().zip(scan) {
            if !silent.contains(&reading.transducer) {
                *verdict = verdict.and_then(|verdict| self.unless_it_clears(channels, reading, verdict));
            }
        }
        verdicts
    }

    /// The sonars of a scan that hear hardly anything, as far as `stuck` is asked for.
    fn silent(&mut self, channels: &[Option<Channel>], scan: &[(Reading, Option<Estimate>)]) -> Vec<u16> {
        if !self.filters.contains(&Filter::Stuck) {
            return Vec::new();
        }
        let is_sonar = |reading: &Reading| {
            let channel = channels.get(usize::from(reading.transducer)).copied().flatten();
            channel.is_some_and(|channel| channel.transducer.kind == SensorKind::Sonar)
        };
        for (reading, _) in scan.iter().filter(|(reading, _)| is_sonar(reading)) {
            match heard(channels, reading) {
                Ok(_) => self.hearing.note(reading.transducer, true),
                Err(Verdict::NoEcho) => self.hearing.note(reading.transducer, false),
                Err(_) => {}
            }
        }
        let usual_share = self.hearing.usual_share();
        let sonars = scan.iter().filter(|(reading, _)| is_sonar(reading)).map(|(reading, _)| reading.transducer);
        sonars.filter(|sonar| self.hearing.is_silent(*sonar, usual_share)).collect()
    }

    /// The verdict on a reading that told no range; none where that says something by itself.
    fn unless_it_clears(&self, channels: &[Option<Channel>], reading: &Reading, verdict: Verdict) -> Option<Verdict> {
        let clears =
            |channel: Channel| channel.selected && self.no_echo.clears(self.fusion.of(channel.transducer.kind));
        let channel = channels.get(usize::from(reading.transducer)).copied().flatten();
        (verdict != Verdict::NoEcho || !channel.is_some_and(clears)).then_some(verdict)
    }
}

/// How many sonars a filter hears: those that are selected, if that is done before.
fn sonars_before(filter: Filter, filters: &[Filter], channels: &[Option<Channel>]) -> usize {
    let place = |filter| filters.iter().position(|other| *other == filter);
    let all = place(Filter::Selection).is_none_or(|selection| place(filter).is_some_and(|own| own < selection));
    let counts = |channel: &&Channel| channel.transducer.kind == SensorKind::Sonar && (all || channel.selected);
    channels.iter().flatten().filter(counts).count()
}

/// Whose a reading is and what range it tells, or why it tells none.
fn heard<'a>(channels: &'a [Option<Channel>], reading: &Reading) -> Result<(&'a Channel, f64), Verdict> {
    let channel = channels.get(usize::from(reading.transducer)).and_then(Option::as_ref).ok_or(Verdict::Invalid)?;
    Ok((channel, range_of(reading.echo)?))
}

/// Why a filter that looks at one reading only refuses it, if it does.
fn alone(filter: Filter, channel: &Channel, range_m: f64) -> Option<Verdict> {
    match filter {
        Filter::Range => channel.refusal(range_m),
        Filter::Selection => (!channel.selected).then_some(Verdict::NotSelected),
        Filter::Stuck | Filter::Lone | Filter::Bubble => None,
    }
}
