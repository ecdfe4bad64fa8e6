//! What lies in a spool, damaged in any way. The first byte says how: bytes of a whole store's file are other ones or cut off, or
//! the tables of a store hold anything. A store is opened and read, or it is said why not; what is read is stored so that it is
//! read again.
#![no_main]

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::OnceLock;

use anyhow::Result;
use echogrid_core::parts::Saved;
use echogrid_core::{MapperConfig, OdometryConfig};
use echogrid_mapper::MapperService;
use echogrid_service::Service;
use echogrid_service::store::{
    Change, Changes, Entry, Measured, Moment, Shelf, Spooled, Store, Table, Unrepeatable, beginning,
};
use echogrid_topics::{Command, TruePose};
use libfuzzer_sys::fuzz_target;

const RUN: u64 = 7;

/// Tables in memory.
#[derive(Debug, Default)]
struct Memory(BTreeMap<(Table, Vec<u8>), Vec<u8>>);

impl Shelf for Memory {
    fn get(&self, table: Table, key: &[u8]) -> Result<Option<Vec<u8>>> {
        Ok(self.0.get(&(table, key.to_vec())).cloned())
    }

    fn range(&self, table: Table, from: &[u8]) -> Result<Vec<(Vec<u8>, Vec<u8>)>> {
        let entries = self.0.range((table, from.to_vec())..).take_while(|((of, _), _)| *of == table);
        Ok(entries.map(|((_, key), value)| (key.clone(), value.clone())).collect())
    }

    fn last(&self, table: Table) -> Result<Option<Vec<u8>>> {
        Ok(self.range(table, &[])?.pop().map(|(key, _)| key))
    }

    fn commit(&mut self, changes: Vec<Change>) -> Result<()> {
        for Change { table, key, value } in changes {
            match value {
                Some(value) => drop(self.0.insert((table, key), value)),
                None => drop(self.0.remove(&(table, key))),
            }
        }
        Ok(())
    }
}

/// The bytes of a whole store's file.
fn whole() -> &'static [u8] {
    static WHOLE: OnceLock<Vec<u8>> = OnceLock::new();
    WHOLE.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("mapper.redb");
        let mut store = Store::open(&file, RUN, true, false).expect("a new store");
        let parts = [("a", vec![7; 5000]), ("b", vec![1, 2])];
        let changes: Changes = parts.into_iter().map(|(name, bytes)| (name.to_owned(), Some(bytes))).collect();
        store.store(&Moment::default(), changes, 0).expect("room");
        let what = Unrepeatable::Command(3, Command::Pause);
        store.write_down(&Entry { at: vec![3], stamp_ns: 5, what }).expect("room");
        let message = Measured::TruePose(TruePose { map_from_base: None });
        store.spool(0, &Spooled { topic: 9, sequence: 1, stamp_ns: 1, message }, |_, _| false).expect("room");
        drop(store);
        std::fs::read(&file).expect("what was stored")
    })
}

/// Others in the place of its bytes, three bytes of the input for each: where, and what; at last it may be cut off.
fn damage_file(input: &[u8]) {
    let (cuts, input) = input.split_first().map_or((false, input), |(first, rest)| (first % 2 == 1, rest));
    let mut bytes = whole().to_vec();
    let mut at = 0;
    for edit in input.chunks_exact(3) {
        at = usize::from(u16::from_le_bytes([edit[0], edit[1]])) * 7 % bytes.len();
        bytes[at] ^= edit[2];
    }
    if cuts {
        bytes.truncate(at);
    }
    thread_local! {
        static FOLDER: RefCell<tempfile::TempDir> = RefCell::new(tempfile::tempdir().expect("a folder"));
    }
    FOLDER.with_borrow(|folder| {
        let file = folder.path().join("mapper.redb");
        std::fs::write(&file, bytes).expect("room");
        if let Err(error) = Store::check(&file, RUN) {
            assert!(format!("{error:#}").contains("mapper.redb"), "{error:#}");
        }
    });
}

/// Tables of anything: for each entry the table, the length of its key and of its value, and both.
fn any_tables(mut input: &[u8]) {
    let mut memory = Memory::default();
    memory.commit(vec![beginning(RUN)]).expect("memory");
    while let [table, key, value, rest @ ..] = input {
        let table = Table::ALL[usize::from(*table) % Table::ALL.len()];
        let (key, rest) = rest.split_at(usize::from(*key).min(rest.len()));
        let (value, rest) = rest.split_at(usize::from(*value).min(rest.len()));
        // Most keys are numbers.
        let number = key.iter().fold(0, |number: u64, byte| number << 8 | u64::from(*byte));
        let key = if matches!(table, Table::Parts | Table::Run) { key.to_vec() } else { number.to_be_bytes().to_vec() };
        memory.0.insert((table, key), value.to_vec());
        input = rest;
    }
    let state: BTreeMap<String, Vec<u8>> = memory
        .range(Table::Parts, &[])
        .expect("memory")
        .into_iter()
        .filter_map(|(name, bytes)| Some((String::from_utf8(name).ok()?, bytes)))
        .collect();
    let keeps_generations = state.is_empty();
    let Ok(mut store) = Store::over(Box::new(memory), Path::new("mapper.redb"), RUN, keeps_generations) else { return };
    let (Ok(moments), Ok(_), Ok(_)) = (store.moments(), store.journal(0), store.spooled()) else { return };
    for generation in moments.keys() {
        let _ = store.state(*generation);
    }
    if let Some(moment) = moments.values().next()
        && let Ok(generation) = store.store(moment, Changes::new(), 0)
    {
        assert_eq!(store.moments().expect("what was read before")[&generation], *moment);
    }
    // A service goes on from it, or says why not.
    let mut mapper = MapperService::new(&MapperConfig::default(), &OdometryConfig::default()).expect("defaults");
    let _ = mapper.restore(&Saved::from_parts(state));
}

fuzz_target!(|input: &[u8]| {
    match input.split_first() {
        Some((0..=127, input)) => damage_file(input),
        Some((_, input)) => any_tables(input),
        None => {}
    }
});
