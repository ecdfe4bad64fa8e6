//! The map of a running graph for who looks on.

use core::ffi::{CStr, c_char};
use std::collections::BTreeMap;
use std::time::Duration;

use anyhow::{Context, Result, anyhow};
use echogrid_core::{TILE_SIDE, TileIndex};
use echogrid_service::onlooker::{Onlooker, Operator};
use echogrid_service::signals::Signals;
use echogrid_topics::{Command, Domain, Layer, Message, TileUpdate, Topic, domain};

/// How long a mapper may take to answer that it tells the whole map.
const ANSWERS_WITHIN: Duration = Duration::from_secs(2);

/// `struct echogrid_map`: what is known of a map.
#[derive(Debug)]
pub struct Map {
    onlooker: Onlooker,
    operator: Operator,
    signals: Signals,
    tiles: BTreeMap<TileIndex, TileUpdate>,
    resolution_m: f64,
    dense: Vec<f32>,
}

/// The cells of a map (`struct echogrid_grid`).
#[derive(Debug)]
#[repr(C)]
pub struct Grid {
    /// The number of rows, from the lowest y up.
    pub rows: u64,
    /// The number of columns, from the lowest x up.
    pub columns: u64,
    /// The x of the lower left corner of the first cell, metres.
    pub origin_x_m: f64,
    /// The y of the lower left corner of the first cell, metres.
    pub origin_y_m: f64,
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Row by row; NaN is unknown.
    pub log_odds: *const f32,
}

impl Map {
    fn open(named: Option<&str>) -> Result<Self> {
        let name = match (named, domain::running().as_slice()) {
            (Some(name), _) => name.to_owned(),
            (None, [only]) => only.clone(),
            (None, all) => {
                return Err(anyhow!("{} graphs run ({}): name the domain of one", all.len(), all.join(", ")));
            }
        };
        let domain = Domain::named(&name)?;
        Ok(Self {
            onlooker: Onlooker::enter(&domain, "c-listener", &[Topic::Health, Topic::MapTiles])?,
            operator: Operator::enter(&domain, "c-listener-orders")?,
            // Those of the program are left to it.
            signals: Signals::collect(&[]).context("watching signals")?,
            tiles: BTreeMap::new(),
            resolution_m: 0.0,
            dense: Vec::new(),
        })
    }

    /// Whether the map changed; none when the graph is gone.
    fn update(&mut self) -> Result<Option<bool>> {
        self.onlooker.wait(&self.signals)?;
        let (mut changed, tiles) = (false, &mut self.tiles);
        let was_there = self.onlooker.take_in(|_, message| {
            let Message::Tile(tile) = message else { return };
            let is_new = tiles.get(&tile.index).is_none_or(|known| known.revision < tile.revision);
            if tile.layer == Layer::Map && is_new {
                tiles.insert(tile.index, tile);
                changed = true;
            }
        })?;
        if self.onlooker.misses_tiles() {
            // A mapper that ends meanwhile has told all that it will.
            let _ = self.operator.order("mapper", Command::Tiles, ANSWERS_WITHIN);
        }
        Ok((was_there || changed).then_some(changed))
    }

    fn grid(&mut self) -> Grid {
        let nothing = Grid {
            rows: 0,
            columns: 0,
            origin_x_m: 0.0,
            origin_y_m: 0.0,
            resolution_m: 0.0,
            log_odds: core::ptr::null(),
        };
        let (Some((first, tile)), size) = (self.tiles.first_key_value(), TILE_SIDE) else { return nothing };
        self.resolution_m = tile.resolution_m;
        let (mut low, mut high) = (*first, *first);
        for index in self.tiles.keys() {
            low = TileIndex { x: low.x.min(index.x), y: low.y.min(index.y) };
            high = TileIndex { x: high.x.max(index.x), y: high.y.max(index.y) };
        }
        let across = |from: i32, to: i32| usize::try_from(i64::from(to) - i64::from(from) + 1).unwrap_or(0) * size;
        let (rows, columns) = (across(low.y, high.y), across(low.x, high.x));
        self.dense.clear();
        self.dense.resize(rows * columns, f32::NAN);
        for (index, tile) in &self.tiles {
            let (row, column) = (across(low.y, index.y) - size, across(low.x, index.x) - size);
            for (at, cells) in tile.log_odds.chunks_exact(size).enumerate() {
                let start = (row + at) * columns + column;
                self.dense[start..start + size].copy_from_slice(cells);
            }
        }
        let corner = |tile: i32| f64::from(tile) * size as f64 * self.resolution_m;
        Grid {
            rows: rows as u64,
            columns: columns as u64,
            origin_x_m: corner(low.x),
            origin_y_m: corner(low.y),
            resolution_m: self.resolution_m,
            log_odds: self.dense.as_ptr(),
        }
    }
}

/// Looks at the map of the graph in `domain`, or of the only one that runs if that is null. Null on failure, with the reason in `error`.
///
/// # Safety
/// `domain` is null or a text with a zero at its end; `error` is null or has room for `error_bytes`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn echogrid_map_open(domain: *const c_char, error: *mut c_char, error_bytes: usize) -> *mut Map {
    // SAFETY: as said above.
    let named = (!domain.is_null()).then(|| unsafe { CStr::from_ptr(domain) }.to_string_lossy().into_owned());
    let why = match std::panic::catch_unwind(|| Map::open(named.as_deref())) {
        Ok(Ok(map)) => return Box::into_raw(Box::new(map)),
        Ok(Err(why)) => echogrid_service::in_words(&why),
        Err(_) => "a fault of libechogrid_c".to_owned(),
    };
    if !error.is_null() && error_bytes > 0 {
        let end = why.len().min(error_bytes - 1);
        // SAFETY: there is room for that and a zero.
        unsafe {
            core::ptr::copy_nonoverlapping(why.as_ptr().cast(), error, end);
            error.add(end).write(0);
        }
    }
    core::ptr::null_mut()
}

/// Takes in what came: 1 if the map changed, 0 if it did not, -1 when the graph has ended.
///
/// # Safety
/// `map` is one that was opened and not closed, used by no other thread meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn echogrid_map_update(map: *mut Map) -> i32 {
    // SAFETY: as said above.
    let Some(map) = (unsafe { map.as_mut() }) else { return -1 };
    let updated = std::panic::catch_unwind(core::panic::AssertUnwindSafe(|| map.update()));
    match updated {
        Ok(Ok(Some(changed))) => i32::from(changed),
        _ => -1,
    }
}

/// The map as it is now; what its `log_odds` points to stays until the next call with the same map.
///
/// # Safety
/// As [`echogrid_map_update`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn echogrid_map_grid(map: *mut Map) -> Grid {
    let nothing =
        Grid { rows: 0, columns: 0, origin_x_m: 0.0, origin_y_m: 0.0, resolution_m: 0.0, log_odds: core::ptr::null() };
    // SAFETY: as said above.
    let Some(map) = (unsafe { map.as_mut() }) else { return nothing };
    std::panic::catch_unwind(core::panic::AssertUnwindSafe(|| map.grid())).unwrap_or(nothing)
}

/// Looks no longer.
///
/// # Safety
/// `map` is null, or one that was opened and not closed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn echogrid_map_close(map: *mut Map) {
    if !map.is_null() {
        // SAFETY: as said above: it came from a box.
        drop(unsafe { Box::from_raw(map) });
    }
}
