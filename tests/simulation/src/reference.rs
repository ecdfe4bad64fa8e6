//! What an undisturbed run comes to, in one thread and without any process.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use anyhow::Result;
use echogrid_core::parts::{Parts, Saved};
use echogrid_formats::map::{MapDocument, MapError, MapFileOptions};
use echogrid_publisher::{PublisherService, Saver};
use echogrid_service::{Input, Outbox, Service, local};
use echogrid_topics::{MapInfo, Message, Topic};

use crate::disk::{self, bytes};
use crate::drive::{Drive, Recording};

/// What is compared.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Ended {
    /// The map's files; none: there is no map.
    pub(crate) map: Option<Vec<u8>>,
    /// The summary.
    pub(crate) info: Option<MapInfo>,
}

#[derive(Debug, Default)]
struct Kept(Rc<RefCell<Option<Vec<u8>>>>);

impl Saver for Kept {
    fn save(&mut self, _folder: &Path, map: &MapDocument, _files: &MapFileOptions) -> Result<Vec<PathBuf>, MapError> {
        *self.0.borrow_mut() = Some(bytes(map));
        Ok(Vec::new())
    }
}

/// Keeps the last summary.
#[derive(Debug, Default)]
struct Summary(Option<MapInfo>);

impl Service for Summary {
    fn inputs(&self) -> &'static [Topic] {
        &[Topic::MapInfo]
    }

    fn outputs(&self) -> &'static [Topic] {
        &[]
    }

    fn step(&mut self, input: Input, _out: &mut Outbox) -> Result<()> {
        if let Input::Message { message: Message::Info(info), .. } = input {
            self.0 = Some(info);
        }
        Ok(())
    }

    fn save(&mut self, _parts: &mut Parts) {}

    fn restore(&mut self, _saved: &Saved) -> Result<()> {
        Ok(())
    }
}

thread_local! {
    static KNOWN: RefCell<BTreeMap<(u8, usize), Rc<Ended>>> = const { RefCell::new(BTreeMap::new()) };
}

/// What the first so many messages of a drive come to.
pub(crate) fn of(drive: Drive, messages: usize) -> Result<Rc<Ended>> {
    let key = (drive as u8, messages);
    if let Some(known) = KNOWN.with_borrow(|known| known.get(&key).cloned()) {
        return Ok(known);
    }
    let kept = Kept::default();
    let map = kept.0.clone();
    let (mut odometry, mut localizer, mut mapper) = (drive.odometry()?, drive.localizer()?, drive.mapper()?);
    let publisher = PublisherService::new(disk::publisher(), PathBuf::new(), Default::default())?;
    let (mut publisher, mut summary) = (publisher.saving_by(Box::new(kept)), Summary::default());
    let mut services: Vec<&mut dyn Service> = vec![&mut odometry];
    if drive.has_localizer() {
        services.push(&mut localizer);
    }
    services.extend([&mut mapper as &mut dyn Service, &mut publisher, &mut summary]);
    let given = &drive.messages()[..messages];
    local::run(&mut Recording::new(given, false, 0), &mut services)?;
    let ended = Rc::new(Ended { map: map.take(), info: summary.0 });
    KNOWN.with_borrow_mut(|known| known.insert(key, ended.clone()));
    Ok(ended)
}
