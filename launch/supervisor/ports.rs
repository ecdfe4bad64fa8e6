//! The launcher's ends of the graph, which is its own.

use anyhow::Result;
use echogrid_topics::owner::Needs;
use echogrid_topics::{Health, Input, MapInfo, Output, Owner, TrueWorld};

use super::run::Graph;

/// The launcher's ends of the graph.
#[derive(Debug)]
pub(super) struct Ports {
    pub(super) health: Input<Health>,
    pub(super) info: Input<MapInfo>,
    pub(super) world: Input<TrueWorld>,
    /// What the launcher says of services that can't say it themselves.
    pub(super) word: Output<Health>,
    // Last: what the others are ports of.
    owner: Owner,
}

impl Ports {
    pub(super) fn create(graph: &mut Graph<'_>) -> Result<Self> {
        let owner = Owner::create(graph.domain.clone(), needs(graph, &names(graph)))?;
        if graph.plan.state.is_none() {
            graph.plan.state = Some(owner.state_dir(graph.kept_bytes)?);
        }
        graph.plan.write(owner.domain())?;
        let participant = owner.participant();
        Ok(Self {
            health: Input::typed(participant)?,
            info: Input::typed(participant)?,
            world: Input::typed(participant)?,
            word: Output::typed(participant, graph.plan.max_readings, graph.plan.epoch, &[])?,
            owner,
        })
    }

    /// All of it made anew. No process may be in it.
    pub(super) fn renew(&mut self, graph: &Graph<'_>) -> Result<()> {
        self.owner.renew(needs(graph, &names(graph)))?;
        graph.plan.write(self.owner.domain())?;
        let participant = self.owner.participant();
        let word = Output::typed(participant, graph.plan.max_readings, graph.plan.epoch, &[])?;
        // To close what is wedged could hang.
        std::mem::forget((
            std::mem::replace(&mut self.health, Input::typed(participant)?),
            std::mem::replace(&mut self.info, Input::typed(participant)?),
            std::mem::replace(&mut self.world, Input::typed(participant)?),
            std::mem::replace(&mut self.word, word),
        ));
        Ok(())
    }
}

fn names<'a>(graph: &Graph<'a>) -> Vec<&'a str> {
    graph.services.keys().map(String::as_str).collect()
}

fn needs<'a>(graph: &Graph<'a>, services: &'a [&'a str]) -> Needs<'a> {
    Needs { max_readings: graph.plan.max_readings, services, declared: graph.topics }
}
