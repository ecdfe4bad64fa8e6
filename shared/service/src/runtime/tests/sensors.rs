//! A life of a sensor: where its streams end.

use super::*;
use crate::Sensor;

/// A sensor that counts, a number a second.
#[derive(Debug, Clone, Copy)]
struct Counter {
    next: u64,
    is_live: bool,
}

impl Sensor for Counter {
    fn outputs(&self) -> &'static [Topic] {
        &[WRITTEN]
    }

    fn is_live(&self) -> bool {
        self.is_live
    }

    fn next(&mut self) -> Result<Option<(u64, Message)>> {
        let odom_from_base = Pose2::new(self.next as f64, 0.0, 0.0);
        self.next += 1;
        let raw = RawOdometry { odom_from_base, v_mps: 0.0, w_radps: 0.0 };
        Ok(Some((self.next * 1_000_000_000, Message::Odometry(raw))))
    }
}

impl Neighbours {
    /// A life of a sensor in the adder's place.
    fn count(&mut self, rate: Option<f64>, mut counter: Counter) -> Life {
        let (mut runtime, switches, pid) = self.runtime(rate, |_, _| Vec::new());
        let future = Box::pin(async move { crate::play::play(&mut runtime, &mut counter).await });
        Life { future, switches, pid }
    }
}

/// Asks a sensor to stop, and gives it turns until it has left: what was heard of it meanwhile.
fn stopped(graph: &mut Neighbours, life: &mut Life) -> Vec<u64> {
    life.tell(Told::Stop);
    let (mut heard, mut ended) = (Vec::new(), false);
    for _ in 0..50 {
        let left = life.turn();
        let (sums, end) = graph.consume();
        heard.extend(sums);
        ended |= end;
        if ended {
            graph.consumer_acks = graph.consumer.taken().sequence;
        }
        if let Poll::Ready(end) = left {
            end.unwrap();
            assert!(ended);
            return heard;
        }
    }
    panic!("it did not leave: {heard:?}, ended {ended}");
}

#[test]
fn a_sensor_ends_no_stream_before_what_an_earlier_life_of_it_had_sent() {
    let mut graph = Neighbours::new();
    let counter = Counter { next: 1, is_live: false };
    let mut life = graph.count(None, counter);
    let mut heard = Vec::new();
    for _ in 0..10 {
        assert!(life.turn().is_pending());
        heard.extend(graph.consume().0);
    }
    assert_eq!(heard, (1..=WINDOW).collect::<Vec<_>>());
    graph.kill(life);
    graph.bus.clean();
    // The next is at its first message when it is asked to stop, and a second would pass until the next.
    let mut life = graph.count(Some(1.0), counter);
    for _ in 0..4 {
        assert!(life.turn().is_pending());
        heard.extend(graph.consume().0);
    }
    heard.extend(stopped(&mut graph, &mut life));
    assert_eq!(heard, (1..=WINDOW).collect::<Vec<_>>());
}

#[test]
fn the_end_comes_after_what_a_live_sensor_had_measured() {
    let mut graph = Neighbours::new();
    let mut life = graph.count(None, Counter { next: 1, is_live: true });
    let mut heard = Vec::new();
    for _ in 0..10 {
        assert!(life.turn().is_pending());
        heard.extend(graph.consume().0);
    }
    // One more is measured, and there was no room for it.
    graph.consumer_acks = WINDOW;
    heard.extend(stopped(&mut graph, &mut life));
    assert_eq!(heard, (1..=WINDOW + 1).collect::<Vec<_>>());
}

#[test]
fn a_live_sensor_that_dies_as_it_ends_measures_no_more_in_its_next_life() {
    let mut graph = Neighbours::new();
    let mut life = graph.count(None, Counter { next: 1, is_live: true });
    let mut heard = Vec::new();
    for _ in 0..10 {
        assert!(life.turn().is_pending());
        heard.extend(graph.consume().0);
    }
    // One more is measured, and waits for room; the end is written down.
    life.tell(Told::Stop);
    for _ in 0..4 {
        assert!(life.turn().is_pending());
        heard.extend(graph.consume().0);
    }
    graph.kill(life);
    graph.bus.clean();
    // Nobody asks the next one to stop.
    let mut life = graph.count(None, Counter { next: 100, is_live: true });
    for _ in 0..50 {
        let left = life.turn();
        heard.extend(graph.consume().0);
        graph.consumer_acks = graph.consumer.taken().sequence;
        if let Poll::Ready(end) = left {
            end.unwrap();
            assert_eq!(heard, (1..=WINDOW + 1).collect::<Vec<_>>());
            return;
        }
    }
    panic!("it did not leave: {heard:?}");
}
