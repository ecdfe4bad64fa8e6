//! A place: what was heard on a piece of way, drawn as a map in the frame of the node in its middle.

use echogrid_core::config::{Fusion, Noise};
use echogrid_core::{Estimate, GridMapper, MapperConfig, Reading, Scales, SensorKind};

use super::slam::SonarSlam;
use crate::known::{EchoMap, Ground, MapModel};

/// Way each way about its middle, metres.
pub(super) const HALF_M: f64 = 4.0;
/// A place is drawn anew when the scales of the odometry are known to be others by this.
const REDRAWN: f64 = 0.005;

/// A place as it was drawn.
#[derive(Debug)]
pub(super) struct Place {
    /// With these scales.
    scales: Scales,
    /// None where too little was heard.
    map: Option<EchoMap>,
}

impl SonarSlam<'_> {
    /// The map of the place about a node, drawn with the scales as they are known now.
    pub(super) fn place(&mut self, about: usize) -> Option<&mut EchoMap> {
        let scales = self.scales();
        let holds = |place: &Place| {
            (place.scales.lin - scales.lin).abs() <= REDRAWN && (place.scales.ang - scales.ang).abs() <= REDRAWN
        };
        if !self.places.get(&about).is_some_and(holds) {
            let map = self.draw(about).map(EchoMap::new);
            self.places.insert(about, Place { scales, map });
        }
        self.places.get_mut(&about)?.map.as_mut()
    }

    fn draw(&self, about: usize) -> Option<Ground> {
        let settings = MapperConfig {
            keep_readings: false,
            doubt: false,
            facing: false,
            sonar_maps: false,
            remap: false,
            ..self.mapper.clone()
        };
        let mut mapper = GridMapper::new(&settings, Noise::OneSigma, 1, self.robot.clone()).ok()?;
        for (node, about_from_node) in self.way_about(about, HALF_M) {
            let about_from_odom = about_from_node * self.nodes[node].odom_from_base.inverse();
            for (sequence, ring) in self.rings_of(node) {
                let placed = |at| Some(Estimate::certain(about_from_odom * at));
                let scan: Vec<(Reading, Option<Estimate>)> =
                    ring.heard.iter().map(|heard| (heard.reading, placed(heard.odom_from_base))).collect();
                mapper.integrate_scan(sequence, &scan);
            }
        }
        let prior = match settings.fusion.of(SensorKind::Sonar) {
            Fusion::Oriented => settings.oriented_prior,
            Fusion::FirstEcho => settings.echo_prior,
            _ => 0.02,
        };
        Ground::of(mapper.grid(), MapModel { prior }).ok()
    }
}
