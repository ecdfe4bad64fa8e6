//! The conversation with a robot: opened, kept up, closed; without I/O and clock.

use core::time::Duration;
use std::collections::VecDeque;

use echogrid_arcos::{Baud, Command, Configuration, Decoder, Found, Identity, Packet, Sip};

/// The robot answers a step of synchronisation within this.
const ANSWERED_WITHIN: Duration = Duration::from_millis(400);
/// So many times a step is tried at one speed of the line.
const TRIES: u32 = 3;
/// A robot that speaks already is listened to for so long before it is called.
const LISTEN: Duration = Duration::from_millis(350);
/// Between two requests for the configuration; so many are made.
const CONFIGURED_WITHIN: Duration = Duration::from_millis(500);
const CONFIGURATION_TRIES: u32 = 4;
/// After a change of speed the robot must be heard within this.
const HEARD_WITHIN: Duration = Duration::from_millis(800);
/// Between two signs of life, where the robot does not say how long it waits for one.
const PULSE: Duration = Duration::from_millis(500);

/// What a session is to do.
#[derive(Debug, Clone)]
pub struct SessionSettings {
    /// Whether the motors are turned on.
    pub motors: bool,
    /// Speeds to try, as the line has one; the first first.
    pub bauds: Vec<Baud>,
    /// A robot that tells nothing for so long is called again.
    pub silence: Duration,
}

/// What came of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Event {
    /// The session is open; whether it was so before, and the robot counts on.
    Opened {
        /// Who answered.
        identity: Identity,
        /// Whether it was open.
        was_open: bool,
    },
    /// How the robot is set up.
    Configured(Configuration),
    /// How the robot is; the first byte was at this place of the stream since [`Session::begin`].
    Sip {
        /// The place of its first byte.
        at: u64,
        /// What it says.
        sip: Sip,
    },
    /// The robot fell silent, or never answered; it is called again.
    Silent,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Whether it speaks already.
    Listening { until: Duration },
    /// A session is open; who is it?
    Asking { until: Duration, tries: u32 },
    /// Step 0, 1 or 2 of synchronisation.
    Syncing { step: u8, until: Duration, tries: u32 },
    /// The line changed its speed.
    Switching { until: Duration, before: usize },
    /// Open.
    Running,
}

/// A conversation with a robot, from the first step of synchronisation on.
#[derive(Debug)]
pub struct Session {
    settings: SessionSettings,
    decoder: Decoder,
    state: State,
    /// Which of the speeds it is.
    baud: usize,
    /// Which speed it is to become, once open.
    wanted: Option<Baud>,
    /// A packet to send, or a speed to change to, in order.
    out: VecDeque<Out>,
    events: VecDeque<Event>,
    identity: Option<Identity>,
    configured: bool,
    /// A configuration whose checksum is wrong: it counts if it comes twice.
    unchecked: Option<Packet>,
    ask_again: Duration,
    asked: u32,
    pulse_every: Duration,
    pulsed: Duration,
    heard: Duration,
}

/// What is to be done with the line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Out {
    /// These bytes are to be sent.
    Bytes(Vec<u8>),
    /// From here on with this speed.
    Baud(Baud),
}

impl Session {
    /// A conversation before [`Session::begin`].
    #[must_use]
    pub fn new(settings: SessionSettings) -> Self {
        Self {
            settings,
            decoder: Decoder::default(),
            state: State::Running,
            baud: 0,
            wanted: None,
            out: VecDeque::new(),
            events: VecDeque::new(),
            identity: None,
            configured: false,
            unchecked: None,
            ask_again: Duration::MAX,
            asked: 0,
            pulse_every: PULSE,
            pulsed: Duration::ZERO,
            heard: Duration::ZERO,
        }
    }

    /// The line was opened, with the first of the speeds, or with the one of before.
    pub fn begin(&mut self, now: Duration) {
        self.decoder = Decoder::default();
        self.out.clear();
        self.state = State::Listening { until: now + LISTEN };
        self.heard = now;
    }

    /// The speed that the line has.
    #[must_use]
    pub fn baud(&self) -> Baud {
        self.settings.bauds.get(self.baud).copied().unwrap_or(Baud::B9600)
    }

    /// Sets the speed that the line is to have from now on, whenever a session is open.
    pub fn switch_to(&mut self, baud: Baud) {
        self.wanted = Some(baud);
    }

    /// Takes in what the line gave; nothing, too, so that time goes on.
    pub fn take(&mut self, bytes: &[u8], now: Duration) {
        self.decoder.push(bytes);
        while let Some(found) = self.decoder.next_packet() {
            self.packet(found, now);
        }
        if let Some(packet) = self.decoder.take_unchecked_configuration() {
            if self.unchecked.as_ref() == Some(&packet) {
                self.configuration(&packet);
            } else if self.is_running() {
                // Once more: two that are the same are hardly damaged.
                self.ask_again = now;
            }
            self.unchecked = Some(packet);
        }
        self.time(now);
    }

    /// The next thing to do with the line.
    pub fn next_out(&mut self) -> Option<Out> {
        self.out.pop_front()
    }

    /// The next thing that happened.
    pub fn next_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// Whether the session is open.
    #[must_use]
    pub fn is_running(&self) -> bool {
        matches!(self.state, State::Running) && self.identity.is_some()
    }

    /// Bytes that belonged to no packet.
    #[must_use]
    pub fn skipped(&self) -> u64 {
        self.decoder.skipped()
    }

    /// Sends a command, if the session is open.
    pub fn send(&mut self, packet: &Packet) {
        if self.is_running() {
            self.out.push_back(Out::Bytes(packet.bytes().to_vec()));
        }
    }

    /// The last words: motors off, sonars off, closed. At any time: an open session must not be left behind.
    pub fn close(&mut self) {
        self.out.clear();
        for packet in
            [Command::Velocity.with(0), Command::Enable.with(0), Command::Sonar.with(0), Command::Close.with(1)]
        {
            self.out.push_back(Out::Bytes(packet.bytes().to_vec()));
        }
        self.state = State::Running;
        self.identity = None;
    }

    fn say(&mut self, packet: &Packet) {
        self.out.push_back(Out::Bytes(packet.bytes().to_vec()));
    }

    fn packet(&mut self, Found { packet, at }: Found, now: Duration) {
        if Sip::is_one(&packet) {
            // One that is not as it should be is as good as damaged.
            let Ok(sip) = Sip::read(&packet) else { return };
            self.heard = now;
            match self.state {
                State::Running if self.identity.is_some() => self.events.push_back(Event::Sip { at, sip }),
                State::Switching { .. } => {
                    self.state = State::Running;
                    self.events.push_back(Event::Sip { at, sip });
                }
                State::Listening { .. } if self.identity.is_some() => self.adopt(now),
                State::Listening { .. } => {
                    self.state = State::Asking { until: now + CONFIGURED_WITHIN, tries: 1 };
                    self.say(&Command::Config.with(1));
                }
                // Somebody's session is open: it ends, and a new one begins.
                State::Syncing { .. } => {
                    self.say(&Command::Close.with(1));
                    self.sync(0, now, 1);
                }
                State::Asking { .. } | State::Running => {}
            }
            return;
        }
        if packet.id() == Configuration::ID {
            self.configuration(&packet);
            if matches!(self.state, State::Asking { .. }) && self.identity.is_some() {
                self.adopt(now);
            }
            return;
        }
        let State::Syncing { step, .. } = self.state else { return };
        match (step, packet.id()) {
            (0 | 1, id) if id == step => self.sync(step + 1, now, 1),
            (2, Identity::ID) => {
                // A bare echo is no answer yet.
                let Ok(identity) = Identity::read(&packet) else { return };
                self.identity = Some(identity);
                self.configured = false;
                self.say(&Command::Open.with(1));
                self.open(now, false);
            }
            // Out of step: from the beginning.
            (_, 0..=2) if packet.id() > step => self.sync(0, now, 1),
            _ => {}
        }
    }

    /// Goes on with a session that was open before.
    fn adopt(&mut self, now: Duration) {
        self.say(&Command::Velocity.with(0));
        self.open(now, true);
    }

    fn open(&mut self, now: Duration, was_open: bool) {
        self.state = State::Running;
        self.heard = now;
        let identity = self.identity.clone().unwrap_or_default();
        self.events.push_back(Event::Opened { identity, was_open });
        self.say(&Command::Pulse.plain());
        self.pulsed = now;
        self.say(&Command::Sonar.with(1));
        self.say(&Command::Enable.with(self.settings.motors.into()));
        if !self.configured {
            self.ask(now, 1);
        }
        let Some(wanted) = self.wanted.filter(|wanted| *wanted != self.baud()) else { return };
        let Some(at) = self.settings.bauds.iter().position(|baud| *baud == wanted) else { return };
        self.say(&Command::HostBaud.with(wanted as i32));
        self.out.push_back(Out::Baud(wanted));
        self.say(&Command::Pulse.plain());
        self.state = State::Switching { until: now + HEARD_WITHIN, before: self.baud };
        self.baud = at;
    }

    fn ask(&mut self, now: Duration, asked: u32) {
        self.say(&Command::Config.with(1));
        (self.asked, self.ask_again) = (asked, now + CONFIGURED_WITHIN);
    }

    fn sync(&mut self, step: u8, now: Duration, tries: u32) {
        self.say(&Command::sync(step));
        self.state = State::Syncing { step, until: now + ANSWERED_WITHIN, tries };
    }

    fn configuration(&mut self, packet: &Packet) {
        let Ok(told) = Configuration::read(packet) else { return };
        if self.configured {
            return;
        }
        self.configured = true;
        self.ask_again = Duration::MAX;
        if told.watchdog_ms > 0 {
            self.pulse_every = PULSE.min(Duration::from_millis(u64::from(told.watchdog_ms)) / 4);
        }
        let Configuration { name, class, subclass, .. } = told.clone();
        self.identity.get_or_insert(Identity { name, class, subclass });
        self.events.push_back(Event::Configured(told));
    }

    /// What is due.
    fn time(&mut self, now: Duration) {
        match self.state {
            State::Listening { until } if now >= until => self.sync(0, now, 1),
            State::Asking { until, tries } if now >= until => {
                if tries < TRIES {
                    self.state = State::Asking { until: now + CONFIGURED_WITHIN, tries: tries + 1 };
                    self.say(&Command::Config.with(1));
                } else {
                    self.say(&Command::Close.with(1));
                    self.sync(0, now, 1);
                }
            }
            State::Syncing { step, until, tries } if now >= until => {
                if tries < TRIES {
                    self.sync(step, now, tries + 1);
                } else if step > 0 {
                    self.sync(0, now, 1);
                } else {
                    self.next_speed(now);
                }
            }
            State::Switching { until, before } if now >= until => {
                // It did not follow: back to where it was.
                self.baud = before;
                self.wanted = None;
                self.out.push_back(Out::Baud(self.baud()));
                self.state = State::Running;
                self.heard = now;
            }
            State::Running if self.identity.is_some() => {
                if now >= self.heard + self.settings.silence {
                    self.events.push_back(Event::Silent);
                    self.decoder.clear();
                    self.sync(0, now, 1);
                    return;
                }
                if now >= self.pulsed + self.pulse_every {
                    self.pulsed = now;
                    self.say(&Command::Pulse.plain());
                }
                if !self.configured && now >= self.ask_again && self.asked < CONFIGURATION_TRIES {
                    self.ask(now, self.asked + 1);
                }
            }
            _ => {}
        }
    }

    /// Nobody answers at this speed of the line.
    fn next_speed(&mut self, now: Duration) {
        if self.settings.bauds.len() > 1 {
            self.baud = (self.baud + 1) % self.settings.bauds.len();
            self.out.push_back(Out::Baud(self.baud()));
        }
        if self.baud == 0 {
            self.events.push_back(Event::Silent);
        }
        self.decoder.clear();
        // Whoever speaks at this speed already is heard before it is called.
        self.state = State::Listening { until: now + LISTEN };
    }
}
