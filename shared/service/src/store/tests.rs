use super::*;

fn moment(written: u64, journal: u64) -> Moment {
    Moment { written: vec![(4, written)], journal, ..Moment::default() }
}

type Part<'a> = (&'a str, Option<&'a [u8]>);

fn changes(parts: &[Part<'_>]) -> Changes {
    parts.iter().map(|(name, bytes)| ((*name).to_owned(), bytes.map(<[u8]>::to_vec))).collect()
}

fn entry(at: u64) -> Entry {
    Entry { at: vec![at], stamp_ns: 0, what: Unrepeatable::Command(at, Command::Pause) }
}

#[test]
fn generations_are_kept_until_they_are_let_go() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("odometry.redb");
    let mut store = Store::open(&file, 7, false, true).unwrap();
    for generation in 0..3 {
        store.write_down(&entry(generation)).unwrap();
        let changes = changes(&[("state", Some(&[generation as u8]))]);
        assert_eq!(store.store(&moment(10 * generation, generation + 1), changes, 0).unwrap(), generation);
    }
    store.store(&moment(30, 3), changes(&[("state", Some(&[3]))]), 1).unwrap();
    drop(store);
    let mut store = Store::open(&file, 7, false, true).unwrap();
    assert_eq!(store.moments().unwrap().keys().copied().collect::<Vec<_>>(), [1, 2, 3]);
    assert_eq!(store.state(2).unwrap()["state"], [2]);
    // The entry that every snapshot knows of is gone.
    assert_eq!(store.journal(0).unwrap().len(), 1);
    assert_eq!(store.journal(3).unwrap().len(), 0);
    store.write_down(&entry(9)).unwrap();
    assert_eq!(store.journal(3).unwrap()[0].at, [9]);
}

#[test]
fn parts_are_stored_as_they_change() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mapper.redb");
    let mut store = Store::open(&file, 7, false, false).unwrap();
    store.store(&moment(0, 0), changes(&[("a", Some(b"1")), ("b", Some(b"2"))]), 0).unwrap();
    store.store(&moment(1, 0), changes(&[("b", None), ("c", Some(b"3"))]), 0).unwrap();
    drop(store);
    let store = Store::open(&file, 7, false, false).unwrap();
    let (generation, last) = store.moments().unwrap().pop_last().unwrap();
    assert_eq!(last, moment(1, 0));
    let names: Vec<String> = store.state(generation).unwrap().into_keys().collect();
    assert_eq!(names, ["a", "c"]);
}

#[test]
fn parts_are_gone_back_to_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("slam.redb");
    let mut store = Store::open(&file, 7, false, true).unwrap();
    let all: [&[Part<'_>]; 4] = [
        &[("a", Some(b"1")), ("b", Some(b"2"))],
        &[("b", None), ("c", Some(b"3"))],
        &[("c", Some(b"4"))],
        &[("a", None), ("b", Some(b"5")), ("c", None)],
    ];
    for (generation, parts) in (0..).zip(all) {
        store.store(&moment(generation, 0), changes(parts), 0).unwrap();
    }
    let state = |store: &Store, generation| -> Vec<(String, Vec<u8>)> {
        store.state(generation).unwrap().into_iter().collect()
    };
    let part = |name: &str, bytes: &[u8]| (name.to_owned(), bytes.to_vec());
    assert_eq!(state(&store, 0), [part("a", b"1"), part("b", b"2")]);
    assert_eq!(state(&store, 1), [part("a", b"1"), part("c", b"3")]);
    assert_eq!(state(&store, 3), [part("b", b"5")]);
    assert_eq!(store.go_back(1).unwrap().into_iter().collect::<Vec<_>>(), state(&store, 1));
    drop(store);
    // What came after it is gone, and what comes now is told from there.
    let mut store = Store::open(&file, 7, false, true).unwrap();
    assert_eq!(store.moments().unwrap().into_keys().collect::<Vec<_>>(), [0, 1]);
    let generation = store.store(&moment(5, 0), changes(&[("d", Some(b"6"))]), 1).unwrap();
    assert_eq!(state(&store, generation), [part("a", b"1"), part("c", b"3"), part("d", b"6")]);
    assert_eq!(state(&store, 1), [part("a", b"1"), part("c", b"3")]);
    assert_eq!(store.moments().unwrap().into_keys().collect::<Vec<_>>(), [1, generation]);
}

#[test]
fn a_spool_keeps_what_is_not_stored_downstream() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("sensor.redb");
    let mut store = Store::open(&file, 7, false, true).unwrap();
    for number in 0..=TRIM_EVERY {
        let message = Measured::TruePose(TruePose { map_from_base: None });
        let spooled = Spooled { topic: 9, sequence: number + 1, stamp_ns: number, message };
        store.spool(number, &spooled, |topic, sequence| topic == 9 && sequence <= 200).unwrap();
    }
    drop(store);
    let (messages, next, trimmed) = Store::open(&file, 7, false, true).unwrap().spooled().unwrap();
    assert_eq!((messages.len() as u64, next), (TRIM_EVERY + 1 - 200, TRIM_EVERY + 1));
    assert_eq!((messages[0].sequence, trimmed[&9]), (201, 200));
}

/// Bytes of a whole store, flipped or cut wherever: an error that names the file, or what was stored; never a panic.
#[test]
fn a_damaged_store_is_told_with_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mapper.redb");
    let mut store = Store::open(&file, 7, true, false).unwrap();
    store.store(&moment(0, 0), changes(&[("a", Some(&[7; 5000])), ("b", Some(b"2"))]), 0).unwrap();
    store.write_down(&entry(3)).unwrap();
    drop(store);
    let whole = std::fs::read(&file).unwrap();
    let mut refused = 0;
    for at in (0..whole.len()).step_by(whole.len() / 60) {
        let mut flipped = whole.clone();
        flipped[at] ^= 0x55;
        for bytes in [flipped.as_slice(), &whole[..at]] {
            std::fs::write(&file, bytes).unwrap();
            let error = match Store::check(&file, 7) {
                Ok(()) => continue,
                Err(error) => format!("{error:#}"),
            };
            assert!(error.contains("mapper.redb"), "{error}");
            refused += 1;
        }
    }
    assert!(refused > 60, "{refused}");
}

#[test]
fn a_key_beyond_all_numbers_is_damage() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mapper.redb");
    for table in [Table::Snapshots, Table::Journal, Table::Spool] {
        let mut shelf = file::open(&file, 7, false).unwrap();
        let moment = postcard::to_allocvec(&Moment::default()).unwrap();
        shelf.commit(vec![Change::put(table, key(u64::MAX), moment)]).unwrap();
        drop(shelf);
        let error = Store::check(&file, 7).unwrap_err();
        assert!(format!("{error:#}").contains("damaged"), "{error:#}");
        std::fs::remove_file(&file).unwrap();
    }
}

#[test]
fn what_is_no_store_is_told_with_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mapper.redb");
    std::fs::write(&file, "something else").unwrap();
    let error = format!("{:#}", Store::open(&file, 7, false, false).unwrap_err());
    assert!(error.contains("mapper.redb"), "{error}");
}

#[test]
fn a_second_life_knows_of_the_first() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("sensor.redb");
    let lives = [(), ()].map(|()| Store::open(&file, 7, false, false).unwrap().begin_life().unwrap());
    assert_eq!(lives, [false, true]);
}
