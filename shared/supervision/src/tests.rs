use std::cell::RefCell;
use std::rc::Rc;

use anyhow::Result;
use echogrid_topics::{Health, ServiceState};

use super::*;

/// Processes that do nothing by themselves, by their numbers: how they ended, and how often they were asked to.
type System = Rc<RefCell<BTreeMap<u32, (Option<End>, u32)>>>;

/// A process that always uses the processor.
const BUSY: u32 = 99;

#[derive(Debug)]
struct Played {
    number: u32,
    system: System,
}

impl Process for Played {
    fn pid(&self) -> u32 {
        self.number
    }

    fn ask_to_stop(&mut self) {
        self.system.borrow_mut().entry(self.number).or_default().1 += 1;
    }

    fn kill(&mut self) {
        self.system.borrow_mut().entry(self.number).or_default().0 = Some(End::Signal(9));
    }

    fn look(&mut self) -> Result<()> {
        Ok(())
    }

    fn end(&self) -> Option<End> {
        self.system.borrow().get(&self.number).and_then(|(end, _)| *end)
    }

    fn usage(&self) -> Option<Usage> {
        Some(Usage { state: if self.number == BUSY { 'R' } else { 'S' }, ..Usage::default() })
    }
}

/// A sensor, an odometry, a mapper and a publisher, in this order, as processes 0 to 3.
fn graph(config: SupervisionConfig) -> (Supervision<Played>, System) {
    graph_with(config, &[])
}

/// With a localizer that the odometry asks, if `more` names it: as process 3, before the publisher.
fn graph_with(config: SupervisionConfig, more: &[&str]) -> (Supervision<Played>, System) {
    let role = |reads: &[&str], writes: &[&str], source| {
        let names = |topics: &[&str]| topics.iter().map(|topic| (*topic).to_owned()).collect();
        let wiring = Wiring { reads: names(reads), looks_on: Vec::new(), writes: names(writes), source };
        Role { wiring, restart: Restart::OnFailure, required: true }
    };
    let services = [
        ("sensor", role(&[], &["odometry/raw"], true)),
        (
            "odometry",
            role(&["odometry/raw", "localization/fix"], &["odometry/estimate", "localization/request"], false),
        ),
        ("mapper", role(&["odometry/estimate"], &["map/tiles"], false)),
        ("publisher", role(&["map/tiles"], &[], false)),
        ("localizer", role(&["localization/request"], &["localization/fix"], false)),
    ];
    let is_there = |(name, _): &(&str, Role)| *name != "localizer" || more.contains(name);
    let services: Vec<_> = services.into_iter().filter(is_there).map(|(name, role)| (name.to_owned(), role)).collect();
    let settings = Settings {
        config,
        alive_within: Duration::from_secs(30),
        ready_within: Duration::from_secs(30),
        is_resumable: true,
        consumers: consumers(&services.iter().cloned().collect::<BTreeMap<_, _>>()),
    };
    let mut graph = Supervision::new(&services, settings, Instant::now());
    let system = System::default();
    for index in graph.due() {
        graph.started(index, Played { number: index as u32, system: system.clone() });
    }
    (0..services.len()).for_each(|index| say(&mut graph, index, ServiceState::Running));
    assert!(graph.has_become_ready());
    (graph, system)
}

fn say(graph: &mut Supervision<Played>, index: usize, state: ServiceState) {
    let name = graph.units[index].name.clone();
    graph.hear(Health::new(name, index as u32, state));
}

/// A service ends so, and that is seen.
fn ends(graph: &mut Supervision<Played>, system: &System, index: usize, end: End) {
    system.borrow_mut().entry(index as u32).or_default().0 = Some(end);
    let dead = graph.reap().unwrap();
    assert_eq!(dead, [index]);
    graph.bury(&dead, &mut |_| {});
}

#[test]
fn of_a_spooled_run_that_fails_nobody_upstream_hears_that_somebody_is_gone() {
    let (mut graph, system) = graph(SupervisionConfig { restarts_max: 0, ..SupervisionConfig::default() });
    ends(&mut graph, &system, 2, End::Signal(9));
    assert!(graph.failures[0].starts_with("mapper: "), "{:?}", graph.failures);
    // What they have stored is what the run is gone on from.
    for index in [0, 1] {
        assert_eq!((graph.units[index].stage, system.borrow()[&(index as u32)].0), (Stage::Lost, Some(End::Signal(9))));
    }
    graph.look(&mut |_| {});
    assert_eq!(system.borrow()[&3].1, 1, "the publisher saves the map so far");
    say(&mut graph, 3, ServiceState::Draining);
    ends(&mut graph, &system, 3, End::Code(0));
    assert!(graph.is_over());
    assert_eq!(graph.gone().count(), 0);
}

#[test]
fn who_waits_to_be_started_when_the_time_is_over_is_a_failure() {
    let (mut graph, system) = graph(SupervisionConfig::default());
    graph.stop();
    ends(&mut graph, &system, 3, End::Signal(9));
    assert!(matches!(graph.units[3].stage, Stage::Waiting(_)));
    // Nothing gets on, and what the dead left can't be cleaned up: it is never started.
    for second in 0..12 {
        let now = graph.now() + Duration::from_secs(1);
        graph.is_now(now);
        (0..3).for_each(|index| say(&mut graph, index, ServiceState::Draining));
        graph.look(&mut |_| {});
        assert_eq!(graph.units[3].stage == Stage::Lost, !graph.failures.is_empty(), "second {second}");
    }
    assert_eq!(graph.failures, ["publisher: it died, and there was no time left to start it again"]);
}

#[test]
fn who_fails_while_it_is_pressed_to_leave_is_a_failure() {
    for (end, is_failure) in [(End::Code(1), true), (End::Signal(9), true), (End::Signal(15), false)] {
        let (mut graph, system) = graph(SupervisionConfig::default());
        graph.stop();
        while system.borrow().get(&3).is_none_or(|(_, asked)| *asked == 0) {
            let now = graph.now() + Duration::from_secs(1);
            graph.is_now(now);
            (0..4).for_each(|index| say(&mut graph, index, ServiceState::Draining));
            graph.look(&mut |_| {});
        }
        ends(&mut graph, &system, 3, end);
        assert_eq!(!graph.failures.is_empty(), is_failure, "{end:?}: {:?}", graph.failures);
    }
}

#[test]
fn a_run_that_the_user_ends_is_done_when_all_have_left() {
    let (mut graph, system) = graph(SupervisionConfig::default());
    graph.stop();
    assert_eq!(system.borrow()[&0].1, 1, "the sensor is asked, and nobody else");
    assert_eq!(system.borrow().len(), 1);
    for index in (0..4).rev() {
        say(&mut graph, index, ServiceState::Finished);
        ends(&mut graph, &system, index, End::Code(0));
    }
    assert!(graph.is_over() && graph.failures.is_empty() && graph.killed.is_empty());
    assert_eq!(graph.gone().collect::<Vec<_>>(), ["sensor", "odometry", "mapper", "publisher"]);
}

/// It may have gone before those upstream, and they wait for nobody else.
#[test]
fn who_says_that_it_is_done_is_waited_for_no_longer() {
    let (mut graph, system) = graph(SupervisionConfig::default());
    say(&mut graph, 3, ServiceState::Draining);
    assert!(graph.words().is_empty());
    say(&mut graph, 3, ServiceState::Finished);
    assert_eq!((graph.words(), graph.words()), (vec!["publisher".to_owned()], Vec::new()));
    // Of another, which said the same, nobody heard it: one comes in its place, and those upstream are still there.
    ends(&mut graph, &system, 2, End::Code(0));
    assert_eq!(graph.gone().collect::<Vec<_>>(), ["publisher"]);
    assert!(matches!(graph.units[2].stage, Stage::Waiting(_)));
}

/// Queues are short, and a reader may have been stopped.
#[test]
fn who_is_gone_is_said_again_until_nobody_is_left_to_hear_it() {
    let (mut graph, system) = graph(SupervisionConfig::default());
    let mut said = Vec::new();
    for index in [3, 2, 1] {
        say(&mut graph, index, ServiceState::Finished);
        ends(&mut graph, &system, index, End::Code(0));
        said = graph.words();
    }
    assert_eq!(said, ["publisher", "mapper", "odometry"], "the last to go comes last");
    let mut again = Vec::new();
    for _ in 0..3 {
        assert!(graph.words().is_empty());
        let later = graph.now() + Duration::from_millis(500);
        graph.is_now(later);
        again.extend(graph.words());
    }
    assert_eq!(again, ["publisher", "mapper", "odometry", "publisher", "mapper", "odometry"]);
}

/// The odometry waits for answers: a localizer that left before it would leave it waiting.
#[test]
fn who_answers_is_asked_to_leave_after_those_who_ask() {
    let (mut graph, system) = graph_with(SupervisionConfig::default(), &["localizer"]);
    graph.stop();
    say(&mut graph, 0, ServiceState::Draining);
    let later = graph.now() + LEAVE_WITHIN;
    graph.is_now(later);
    let asked = |index: u32| system.borrow().get(&index).map_or(0, |(_, asked)| *asked);
    for (leaves, spared) in [(2, vec![1, 3]), (4, vec![1, 3]), (1, vec![3]), (3, vec![])] {
        // Somebody got on: nobody is pressed.
        let health = graph.units[0].name.clone();
        graph.hear(Health { progress: 10 + u64::from(leaves), ..Health::new(health, 0, ServiceState::Draining) });
        graph.hurry();
        assert!(asked(leaves) > 0 && spared.iter().all(|index| asked(*index) == 0), "{leaves}");
        say(&mut graph, leaves as usize, ServiceState::Draining);
        ends(&mut graph, &system, leaves as usize, End::Code(0));
    }
}

/// SLAM with sonars works on when the drive is over; the mapper has nothing until then.
#[test]
fn who_waits_for_what_is_still_worked_on_is_not_asked_to_leave_before() {
    let (mut graph, system) = graph(SupervisionConfig::default());
    graph.stop();
    say(&mut graph, 0, ServiceState::Draining);
    ends(&mut graph, &system, 0, End::Code(0));
    let asked = |index: u32| system.borrow().get(&index).map_or(0, |(_, asked)| *asked);
    let say_of = |graph: &mut Supervision<_>, index: usize, waits_for| {
        let name = graph.units[index].name.clone();
        graph.hear(Health { waits_for, ..Health::new(name, index as u32, ServiceState::Running) });
    };
    say_of(&mut graph, 1, None);
    say_of(&mut graph, 2, Some(Topic::OdometryEstimate));
    for _ in 0..5 {
        let later = graph.now() + LEAVE_WITHIN;
        graph.is_now(later);
        graph.hurry();
        assert_eq!(asked(2), 0, "what it is to map is not known yet");
    }
    ends(&mut graph, &system, 1, End::Code(0));
    say_of(&mut graph, 2, None);
    graph.hurry();
    assert_eq!(asked(2), 0, "it has only just got it");
    let later = graph.now() + LEAVE_WITHIN;
    graph.is_now(later);
    graph.hurry();
    assert_eq!(asked(2), 1);
}

/// A robot that is looked for in a saved map: the odometry waits for where it is, and the mapper for the odometry.
#[test]
fn who_waits_for_an_answer_that_is_still_worked_on_is_not_asked_to_leave_before() {
    let (mut graph, system) = graph_with(SupervisionConfig::default(), &["localizer"]);
    graph.stop();
    say(&mut graph, 0, ServiceState::Draining);
    ends(&mut graph, &system, 0, End::Code(0));
    let asked = |index: u32| system.borrow().get(&index).map_or(0, |(_, asked)| *asked);
    let say_of = |graph: &mut Supervision<_>, index: usize, waits_for| {
        let name = graph.units[index].name.clone();
        graph.hear(Health { waits_for, ..Health::new(name, index as u32, ServiceState::Running) });
    };
    let wait = |graph: &mut Supervision<_>| {
        let later = graph.now() + LEAVE_WITHIN;
        graph.is_now(later);
        graph.hurry();
    };
    say_of(&mut graph, 1, Some(Topic::LocalizationFix));
    say_of(&mut graph, 2, Some(Topic::OdometryEstimate));
    say_of(&mut graph, 3, None);
    for _ in 0..5 {
        wait(&mut graph);
        assert_eq!(asked(2), 0, "where the robot is is not known yet");
    }
    // They wait for each other: nobody is at work.
    say_of(&mut graph, 3, Some(Topic::LocalizationRequest));
    wait(&mut graph);
    assert_eq!(asked(2), 1);
}

/// Such as a program of somebody's own that ignores signals, and does something every second.
#[test]
fn who_never_said_a_word_and_was_asked_to_leave_keeps_nobody() {
    for is_asked in [false, true] {
        let (mut graph, system) = graph(SupervisionConfig::default());
        graph.started(3, Played { number: BUSY, system: system.clone() });
        if is_asked {
            graph.units[3].alive_mut().unwrap().ask_to_stop();
        }
        let gets_on: Vec<bool> = (1..4)
            .map(|_| {
                let later = graph.now() + Duration::from_secs(5);
                graph.is_now(later);
                (0..3).for_each(|index| say(&mut graph, index, ServiceState::Running));
                graph.look_at_processes(&mut |_| {});
                graph.gets_on()
            })
            .collect();
        assert_eq!(gets_on[1..], [!is_asked; 2]);
    }
}
