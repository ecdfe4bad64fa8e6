use proptest::prelude::*;

use super::*;
use crate::contract::testing::{amount, any_bytes, incidents, number, refused, sent, survives};

fn tile() -> impl Strategy<Value = TileUpdate> {
    // Doubt is never negative, and a normal has no sign.
    let cell = prop_oneof![Just(f32::NAN), 0.0_f32..core::f32::consts::PI];
    let cells = prop::collection::vec(cell, TILE_CELLS).prop_map(|cells| Box::new(cells.try_into().unwrap()));
    let layer =
        prop_oneof![Just(Layer::Map), any::<u16>().prop_map(Layer::Sonar), Just(Layer::Doubt), Just(Layer::Facing)];
    (layer, -(1 << 24)..=1 << 24, -(1 << 24)..=1 << 24, any::<u64>(), 1e-3..1e3, cells).prop_map(
        |(layer, x, y, revision, resolution_m, log_odds)| TileUpdate {
            layer,
            index: TileIndex { x, y },
            revision,
            resolution_m,
            log_odds,
        },
    )
}

fn info() -> impl Strategy<Value = MapInfo> {
    let bounds =
        any::<[i32; 4]>().prop_map(|[i, j, i_high, j_high]| (CellIndex { i, j }, CellIndex { i: i_high, j: j_high }));
    let counts = any::<[u64; Verdict::COUNT]>().prop_map(|counts| {
        let mut verdicts = VerdictCounts::default();
        Verdict::ALL.into_iter().zip(counts).for_each(|(verdict, count)| verdicts.add_many(verdict, count));
        verdicts
    });
    let cells = prop::option::of((1_u64.., bounds));
    let sonars = prop::collection::vec(any::<[u32; Verdict::COUNT]>(), 0..=MAX_SENSORS).prop_map(|sonars| {
        let counts = |counts: [u32; Verdict::COUNT]| {
            let mut verdicts = VerdictCounts::default();
            Verdict::ALL.into_iter().zip(counts).for_each(|(verdict, count)| verdicts.add_many(verdict, count.into()));
            verdicts
        };
        sonars.into_iter().map(counts).collect::<Vec<_>>()
    });
    let flags = (any::<([bool; 4], (u32, u32))>(), sonars, incidents(), incidents());
    (any::<[u64; 6]>(), cells, amount(), number(), amount(), counts, flags).prop_map(
        |(
            [revision, scans, occupied, free, remapped, remap_left],
            cells,
            entropy_bits,
            trust,
            distance_m,
            verdicts,
            ((flags, (fixes, fixes_refused)), sonars, leaps, contradictions),
        )| {
            MapInfo {
                revision,
                scans,
                cells_known: cells.map_or(0, |(known, _)| known),
                cells_occupied: occupied,
                cells_free: free,
                entropy_bits,
                trust,
                distance_m,
                bounds: cells.map(|(_, bounds)| bounds),
                verdicts,
                remapped,
                remap_left,
                finished: flags[0],
                degraded: flags[1],
                held: flags[2],
                unplaced: flags[3],
                fixes,
                fixes_refused,
                leaps,
                contradictions,
                sonars,
            }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    /// Unknown stays unknown, and every known cell keeps its bits.
    #[test]
    fn a_tile_arrives(tile in tile()) {
        let arrived = sent::<TileWire, _>(&tile);
        prop_assert_eq!((arrived.index, arrived.revision, arrived.resolution_m), (tile.index, tile.revision, tile.resolution_m));
        prop_assert!(arrived.log_odds.iter().zip(tile.log_odds.iter()).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
}

proptest! {
    #[test]
    fn what_is_sent_arrives(info in info()) {
        prop_assert_eq!(sent::<MapInfoWire, _>(&info), info);
    }

    #[test]
    fn any_bytes_are_survived(bytes in any_bytes()) {
        survives::<TileWire, TileUpdate>(&bytes);
        survives::<MapInfoWire, MapInfo>(&bytes);
    }
}

fn good_tile() -> TileWire {
    TileWire { resolution_m: 0.05, ..TileWire::default() }
}

#[test]
fn tiles_that_cannot_be() {
    let check = |field, spoil: fn(&mut TileWire)| refused::<_, TileUpdate>(good_tile(), field, spoil);
    assert!(TileUpdate::try_from(&good_tile()).is_ok());
    check("layer", |w| w.layer = 5);
    let state = |w: &mut TileWire| (w.layer, w.sonar, w.log_odds) = (4, 8, [0.5; TILE_CELLS]);
    let mut good = good_tile();
    state(&mut good);
    assert_eq!(TileUpdate::try_from(&good).unwrap().layer, Layer::State(8));
    check("sonar", |w| (w.layer, w.sonar, w.log_odds) = (4, 9, [0.5; TILE_CELLS]));
    check("log_odds", |w| (w.layer, w.sonar, w.log_odds) = (4, 8, [f32::NAN; TILE_CELLS]));
    check("log_odds", |w| (w.layer, w.log_odds[5]) = (3, core::f32::consts::PI));
    check("log_odds", |w| (w.layer, w.log_odds[5]) = (2, -0.1));
    check("resolution_m", |w| w.resolution_m = 0.0);
    check("resolution_m", |w| w.resolution_m = f64::NAN);
    check("resolution_m", |w| w.resolution_m = 1e300);
    check("tile_x", |w| w.tile_x = (1 << 24) + 1);
    check("tile_y", |w| w.tile_y = i32::MIN);
    check("log_odds", |w| w.log_odds[TILE_CELLS - 1] = f32::NEG_INFINITY);
}

#[test]
fn numbers_of_a_map_that_cannot_be() {
    let check = |field, spoil: fn(&mut MapInfoWire)| refused::<_, MapInfo>(MapInfoWire::default(), field, spoil);
    assert!(MapInfo::try_from(&MapInfoWire::default()).is_ok());
    check("sonar_count", |w| w.sonar_count = 257);
    check("entropy_bits", |w| w.entropy_bits = -1.0);
    check("trust", |w| w.trust = f64::NAN);
    check("distance_m", |w| w.distance_m = f64::INFINITY);
}

#[test]
fn numbers_of_a_map_as_json() {
    let mut verdicts = VerdictCounts::default();
    verdicts.add_many(Verdict::Accepted, 3);
    let corner = CellIndex { i: -1, j: 2 };
    let info = MapInfo { verdicts, sonars: vec![verdicts], bounds: Some((corner, corner)), ..MapInfo::default() };
    let json = info.json();
    assert_eq!(json["bounds"], json!([[-1, 2], [-1, 2]]));
    assert_eq!((&json["verdicts"]["accepted"], &json["sonars"][0]["accepted"]), (&json!(3), &json!(3)));
}

#[test]
fn tiles_as_json() {
    let mut tile = TileUpdate::try_from(&good_tile()).unwrap();
    tile.log_odds.fill(f32::NAN);
    (tile.layer, tile.log_odds[1]) = (Layer::Sonar(3), 0.5);
    let json = tile.json();
    assert_eq!((&json["layer"], &json["cells_known"]), (&json!({ "sonar": 3 }), &json!(1)));
    assert_eq!((&json["log_odds"][0], &json["log_odds"][1]), (&json!(null), &json!(0.5)));
    assert_eq!(tile.brief().get("log_odds"), None);
}
