// What the service told: docs/live.md describes the messages. No drawing here.
'use strict';

const CELLS = 64, CHUNK = 8; // cells of a tile's side, tiles of a chunk's side
const TILES = 1, TRAIL = 2, BEAMS = 3;

const scene = {
  facts: {}, pose: null, map: null, services: [], log: [],
  layers: new Map(), // 'occupancy', 'doubt', 'sonar 3' → Map of tiles
  hasDoubt: false, sonars: [],
  trail: { generation: -1, points: [] },
  beams: [], ended: false, greeted: false,
};

function layerName(kind, sonar) {
  return kind === 0 ? 'occupancy' : kind === 2 ? 'doubt' : `sonar ${sonar}`;
}

/** Everything of before is void: another graph, or the same made anew. */
function forgetScene() {
  Object.assign(scene, { pose: null, map: null, services: [], hasDoubt: false, sonars: [], beams: [], ended: false });
  scene.layers.clear();
  scene.trail = { generation: -1, points: [] };
}

/** Takes in a binary message; what changed: the name of a layer and its tiles, 'trail' or 'beams'. */
function takeBinary(buffer) {
  const view = new DataView(buffer);
  switch (view.getUint8(0)) {
    case TILES: return takeTiles(view, buffer);
    case TRAIL: return takeTrail(view);
    case BEAMS: return takeBeams(view);
    default: return null;
  }
}

function takeTiles(view, buffer) {
  const name = layerName(view.getUint8(1), view.getUint16(2, true));
  const layer = scene.layers.get(name) ?? new Map();
  scene.layers.set(name, layer);
  const tiles = [];
  let at = 8;
  for (let left = view.getUint32(4, true); left > 0; left--) {
    const x = view.getInt32(at, true), y = view.getInt32(at + 4, true);
    const known = new Uint8Array(buffer, at + 8, CELLS * CELLS / 8);
    const levels = new Uint8Array(buffer, at + 8 + known.length, CELLS * CELLS);
    at += 8 + known.length + levels.length;
    // Copies: a message holds many tiles, and each may outlive the others.
    const tile = { x, y, known: known.slice(), levels: levels.slice() };
    layer.set(`${x},${y}`, tile);
    tiles.push(tile);
  }
  return { kind: 'tiles', name, tiles };
}

function takeTrail(view) {
  const generation = view.getUint32(4, true), start = view.getUint32(8, true);
  if (generation !== scene.trail.generation) scene.trail = { generation, points: [] };
  scene.trail.points.length = Math.min(scene.trail.points.length, start);
  for (let at = 12; at < view.byteLength; at += 24) {
    scene.trail.points.push({
      t: view.getFloat64(at, true), x: view.getFloat32(at + 8, true), y: view.getFloat32(at + 12, true),
      theta: view.getFloat32(at + 16, true), trust: view.getFloat32(at + 20, true),
    });
  }
  return { kind: 'trail' };
}

function takeBeams(view) {
  const beams = [];
  for (let at = 16; at < view.byteLength; at += 24) {
    const f = (offset) => view.getFloat32(at + offset, true);
    beams.push({
      x: f(0), y: f(4), angle: f(8), range: f(12), aperture: f(16),
      transducer: view.getUint16(at + 20, true), verdict: view.getUint8(at + 22), echo: view.getUint8(at + 23),
    });
  }
  scene.beams = beams;
  return { kind: 'beams' };
}

/** The level of the cell at a place of the map frame; null where it is unknown. */
function levelAt(name, x, y) {
  const r = scene.facts.resolution_m;
  if (!r) return null;
  const i = Math.floor(x / r), j = Math.floor(y / r);
  const tile = scene.layers.get(name)?.get(`${Math.floor(i / CELLS)},${Math.floor(j / CELLS)}`);
  if (!tile) return null;
  const cell = (((j % CELLS) + CELLS) % CELLS) * CELLS + ((i % CELLS) + CELLS) % CELLS;
  return (tile.known[cell >> 3] >> (cell & 7)) & 1 ? tile.levels[cell] : null;
}

/** Lowest and highest corner of what is known, in cells; null where nothing is. */
function knownBounds(name) {
  let [x0, y0, x1, y1] = [Infinity, Infinity, -Infinity, -Infinity];
  for (const tile of scene.layers.get(name)?.values() ?? []) {
    tile.box ??= boxOf(tile);
    if (!tile.box) continue;
    x0 = Math.min(x0, tile.x * CELLS + tile.box[0]); y0 = Math.min(y0, tile.y * CELLS + tile.box[1]);
    x1 = Math.max(x1, tile.x * CELLS + tile.box[2]); y1 = Math.max(y1, tile.y * CELLS + tile.box[3]);
  }
  return x0 > x1 ? null : [x0, y0, x1, y1];
}

function boxOf(tile) {
  let [x0, y0, x1, y1] = [CELLS, CELLS, -1, -1];
  for (let cell = 0; cell < CELLS * CELLS; cell++) {
    if (!((tile.known[cell >> 3] >> (cell & 7)) & 1)) continue;
    const x = cell % CELLS, y = cell / CELLS | 0;
    x0 = Math.min(x0, x); x1 = Math.max(x1, x); y0 = Math.min(y0, y); y1 = Math.max(y1, y);
  }
  return x1 < 0 ? false : [x0, y0, x1, y1];
}
