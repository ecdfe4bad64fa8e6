// The map and what is on it.

const canvas = document.getElementById('map'), context = canvas.getContext('2d');
const view = {
  x: 0, y: 0, // metres of the map frame in the middle of the window
  scale: 40, // pixels to a metre
  follow: false, fitted: true, layer: 'occupancy', beams: true,
  fix: null, // a pose that is being said: { x, y, theta }
  asked: null, // the cell that was clicked, and the readings behind it
};

const chunks = new Map(); // layer → Map of chunks
let dirty = true;
const redraw = () => { dirty = true; };

/** Where the map may be seen between the panels, pixels. */
function openArea() {
  const panel = document.getElementById('panel').getBoundingClientRect();
  const wide = innerWidth > 760, shown = !document.body.classList.contains('no-panel');
  const right = wide && shown ? innerWidth - panel.left : 0;
  return { left: 0, top: wide ? 0 : 56, right: innerWidth - right, bottom: wide ? innerHeight : Math.max(120, panel.top) };
}

function middle() {
  const { left, top, right, bottom } = openArea();
  return [(left + right) / 2, (top + bottom) / 2];
}

const toScreen = (x, y) => { const [mx, my] = middle(); return [mx + (x - view.x) * view.scale, my - (y - view.y) * view.scale]; };
const toMap = (px, py) => { const [mx, my] = middle(); return [view.x + (px - mx) / view.scale, view.y - (py - my) / view.scale]; };

function zoom(factor, px, py) {
  const [x, y] = toMap(px, py);
  view.scale = Math.min(2000, Math.max(0.5, view.scale * factor));
  if (!view.follow) {
    const [nx, ny] = toMap(px, py);
    view.x += x - nx; view.y += y - ny;
  }
  view.fitted = false;
  redraw();
}

/** Shows all that is known, and the robot. */
function fit() {
  const r = scene.facts.resolution_m, known = knownBounds('occupancy');
  let box = known && [known[0] * r, known[1] * r, (known[2] + 1) * r, (known[3] + 1) * r];
  if (scene.pose && !scene.pose.is_unplaced) {
    const { x, y } = scene.pose;
    box = box ? [Math.min(box[0], x - 1), Math.min(box[1], y - 1), Math.max(box[2], x + 1), Math.max(box[3], y + 1)] : [x - 5, y - 5, x + 5, y + 5];
  }
  if (!box) return;
  const area = openArea();
  const side = innerWidth > 760 ? 70 : 24, room = innerWidth > 760 ? 64 : 40;
  const scale = Math.min((area.right - area.left - 2 * side) / (box[2] - box[0]), (area.bottom - area.top - 2 * room) / (box[3] - box[1]));
  Object.assign(view, { x: (box[0] + box[2]) / 2, y: (box[1] + box[3]) / 2, scale: Math.max(0.5, Math.min(400, scale)), fitted: true });
  redraw();
}

// Cells

function paintTile(name, tile) {
  const layer = chunks.get(name) ?? new Map();
  chunks.set(name, layer);
  const cx = Math.floor(tile.x / CHUNK), cy = Math.floor(tile.y / CHUNK), key = `${cx},${cy}`;
  let chunk = layer.get(key);
  if (!chunk) {
    const picture = document.createElement('canvas');
    picture.width = picture.height = CHUNK * CELLS;
    chunk = { cx, cy, picture, pen: picture.getContext('2d', { willReadFrequently: false }) };
    layer.set(key, chunk);
  }
  const colours = palette(name), image = chunk.pen.createImageData(CELLS, CELLS), data = image.data;
  for (let cell = 0; cell < CELLS * CELLS; cell++) {
    if (!((tile.known[cell >> 3] >> (cell & 7)) & 1)) continue;
    const [r, g, b] = colours[tile.levels[cell]];
    // North is up: the first row of a picture has the highest y.
    const at = ((CELLS - 1 - (cell / CELLS | 0)) * CELLS + cell % CELLS) * 4;
    data[at] = r; data[at + 1] = g; data[at + 2] = b; data[at + 3] = 255;
  }
  chunk.pen.putImageData(image, (tile.x - cx * CHUNK) * CELLS, (CHUNK - 1 - (tile.y - cy * CHUNK)) * CELLS);
}

function repaintTiles() {
  chunks.clear();
  for (const [name, tiles] of scene.layers) for (const tile of tiles.values()) paintTile(name, tile);
  redraw();
}

function drawCells() {
  const side = CHUNK * CELLS * scene.facts.resolution_m, pixels = view.scale * scene.facts.resolution_m * devicePixelRatio;
  context.imageSmoothingEnabled = pixels < 1;
  context.imageSmoothingQuality = 'medium';
  const names = view.layer === 'doubt' ? ['occupancy', 'doubt'] : [view.layer];
  for (const name of names) {
    context.globalAlpha = view.layer === 'doubt' && name === 'occupancy' ? 0.35 : view.layer === 'doubt' ? 0.8 : 1;
    for (const { cx, cy, picture } of chunks.get(name)?.values() ?? []) {
      const [x0, y0] = toScreen(cx * side, (cy + 1) * side).map(snap), [x1, y1] = toScreen((cx + 1) * side, cy * side).map(snap);
      if (x1 < 0 || y1 < 0 || x0 > innerWidth || y0 > innerHeight) continue;
      context.drawImage(picture, x0, y0, x1 - x0, y1 - y0);
    }
  }
  context.globalAlpha = 1;
}

/** To whole pixels, so that no seam shows between chunks. */
const snap = (at) => Math.round(at * devicePixelRatio) / devicePixelRatio;

function drawGrid() {
  const metres = niceLength(90 / view.scale), ink = isNight() ? '228,235,243' : '23,33,45';
  const [west, north] = toMap(0, 0), [east, south] = toMap(innerWidth, innerHeight);
  context.lineWidth = 1;
  for (const [from, to, along] of [[west, east, 0], [south, north, 1]]) {
    for (let line = Math.ceil(from / metres); line * metres <= to; line++) {
      context.strokeStyle = `rgba(${ink},${line === 0 ? 0.22 : 0.07})`;
      const at = snap(toScreen(line * metres, line * metres)[along]) + 0.5;
      context.beginPath();
      if (along) { context.moveTo(0, at); context.lineTo(innerWidth, at); } else { context.moveTo(at, 0); context.lineTo(at, innerHeight); }
      context.stroke();
    }
  }
}

/** 1, 2 or 5 times a power of ten, at least so long. */
function niceLength(metres) {
  const power = 10 ** Math.floor(Math.log10(metres));
  return [1, 2, 5, 10].map((times) => times * power).find((length) => length >= metres * 0.999);
}

// The way: pieces of a colour each, whose shapes are kept in metres.

const PIECE_MAX = 128, SHADES = 12;
let pieces = [], piecesOf = -1;
const shadeOf = (trust) => Math.round(trust * SHADES);

function drawTrail() {
  const { generation, points } = scene.trail;
  if (piecesOf !== generation) { pieces = []; piecesOf = generation; }
  const [mx, my] = middle();
  context.save();
  context.translate(mx - view.x * view.scale, my + view.y * view.scale);
  context.scale(view.scale, -view.scale);
  context.lineWidth = 2 / view.scale;
  context.lineJoin = context.lineCap = 'round';
  growPieces(points);
  for (const { shape, shade } of pieces) {
    context.strokeStyle = trustColour(shade / SHADES);
    context.stroke(shape);
  }
  const end = points[points.length - 1], pose = scene.pose;
  // What lies between the last point and the robot is shorter than a step of the trail.
  if (end && pose && !pose.is_unplaced) {
    context.strokeStyle = trustColour(pose.trust);
    context.beginPath(); context.moveTo(end.x, end.y); context.lineTo(pose.x, pose.y); context.stroke();
  }
  context.restore();
}

function growPieces(points) {
  let piece = pieces[pieces.length - 1], at = piece ? piece.last + 1 : 1;
  for (; at < points.length; at++) {
    const shade = shadeOf(points[at].trust);
    if (!piece || piece.shade !== shade || at - piece.first >= PIECE_MAX) {
      piece = { shape: new Path2D(), shade, first: at - 1, last: at };
      piece.shape.moveTo(points[at - 1].x, points[at - 1].y);
      pieces.push(piece);
    }
    piece.shape.lineTo(points[at].x, points[at].y);
    piece.last = at;
  }
}

// Readings

function drawBeams() {
  for (const beam of scene.beams) {
    if (beam.echo === 2) continue;
    const name = scene.facts.verdicts?.[beam.verdict]?.name;
    if (name === 'not_selected' || name === 'invalid') continue;
    drawBeam(beam, verdictColour(beam.verdict), beam.echo === 1 ? 0.35 : 1);
  }
}

function drawBeam({ x, y, angle, range, aperture }, colour, strength) {
  const [px, py] = toScreen(x, y), reach = range * view.scale, half = aperture / 2;
  context.fillStyle = context.strokeStyle = colour;
  if (half > 0.02) {
    context.globalAlpha = 0.13 * strength;
    context.beginPath(); context.moveTo(px, py); context.arc(px, py, reach, -angle - half, -angle + half); context.closePath(); context.fill();
    context.globalAlpha = 0.9 * strength;
    context.lineWidth = strength < 1 ? 1 : 2;
    context.beginPath(); context.arc(px, py, reach, -angle - half, -angle + half); context.stroke();
  } else {
    const ex = px + reach * Math.cos(angle), ey = py - reach * Math.sin(angle);
    context.globalAlpha = 0.16 * strength; context.lineWidth = 1;
    context.beginPath(); context.moveTo(px, py); context.lineTo(ex, ey); context.stroke();
    if (strength === 1) { context.globalAlpha = 0.9; context.beginPath(); context.arc(ex, ey, 1.8, 0, 7); context.fill(); }
  }
  context.globalAlpha = 1;
}

// Robot

function drawRobot({ x, y, theta }, colour, ghost) {
  const [px, py] = toScreen(x, y), robot = scene.facts.robot ?? {};
  const length = Math.max((robot.length_m || 0.5) * view.scale, 16), width = Math.max((robot.width_m || 0.45) * view.scale, 13);
  context.save();
  context.translate(px, py); context.rotate(-theta);
  context.globalAlpha = ghost ? 0.75 : 1;
  context.shadowColor = 'rgba(0,0,0,.35)'; context.shadowBlur = 6;
  context.fillStyle = colour; context.strokeStyle = '#fff'; context.lineWidth = 1.5;
  context.beginPath(); context.roundRect(-length / 2, -width / 2, length, width, Math.min(length, width) * 0.28); context.fill();
  context.shadowBlur = 0; context.stroke();
  context.fillStyle = '#fff';
  context.beginPath(); context.moveTo(length * 0.34, 0); context.lineTo(-length * 0.16, width * 0.27); context.lineTo(-length * 0.04, 0); context.lineTo(-length * 0.16, -width * 0.27); context.closePath(); context.fill();
  context.restore();
}

/** Where it is with 95 %, and how its heading may differ (2 σ). */
function drawDoubtOf({ x, y, theta, covariance: [xx, xy, yy, tt] }, colour) {
  const [px, py] = toScreen(x, y);
  const mean = (xx + yy) / 2, off = Math.hypot((xx - yy) / 2, xy), tilt = 0.5 * Math.atan2(2 * xy, xx - yy);
  const [major, minor] = [mean + off, mean - off].map((variance) => Math.sqrt(5.991 * Math.max(0, variance)) * view.scale);
  context.strokeStyle = context.fillStyle = colour;
  context.lineWidth = 1.5;
  if (major > 3) {
    context.beginPath(); context.ellipse(px, py, major, Math.max(minor, 1), -tilt, 0, 2 * Math.PI);
    context.globalAlpha = 0.16; context.fill(); context.globalAlpha = 0.9; context.stroke();
  }
  const turn = Math.min(Math.PI, 2 * Math.sqrt(Math.max(0, tt))), reach = Math.max(34, major + 14);
  if (turn > 0.01) {
    context.globalAlpha = 0.2;
    context.beginPath(); context.moveTo(px, py); context.arc(px, py, reach, -theta - turn, -theta + turn); context.closePath(); context.fill();
  }
  context.globalAlpha = 1;
}

function drawAsked() {
  const { cell, readings, chosen } = view.asked, r = scene.facts.resolution_m;
  readings?.forEach((reading, index) => {
    const colour = !reading.is_used ? '#7f8c9b' : reading.added > 0 ? '#e03131' : '#2f7fe0';
    const beam = { x: reading.x, y: reading.y, angle: reading.angle_rad, range: reading.reach_m ?? 0, aperture: reading.aperture_rad ?? 0 };
    if (chosen == null || chosen === index) drawBeam(beam, colour, chosen === index ? 1 : 0.55);
  });
  const [x0, y0] = toScreen(cell[0] - r / 2, cell[1] + r / 2), side = r * view.scale, grown = Math.max(0, 10 - side) / 2;
  context.lineWidth = 2; context.strokeStyle = '#ff2d78';
  context.strokeRect(x0 - grown, y0 - grown, side + 2 * grown, side + 2 * grown);
}

// A picture, when something changed

function draw() {
  requestAnimationFrame(draw);
  if (!dirty) return;
  dirty = false;
  const [width, height] = [innerWidth, innerHeight].map((side) => Math.round(side * devicePixelRatio));
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const { pose } = scene, accent = isNight() ? '#5b9dff' : '#1f63e0';
  if (view.fitted && !view.follow) fit();
  if (view.follow && pose) Object.assign(view, { x: pose.x, y: pose.y });
  dirty = false;
  context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
  context.fillStyle = `rgb(${unknownColour().join()})`;
  context.fillRect(0, 0, innerWidth, innerHeight);
  if (scene.facts.resolution_m) drawCells();
  drawGrid();
  drawTrail();
  if (view.beams && !view.asked) drawBeams();
  if (view.asked) drawAsked();
  if (pose && !pose.is_unplaced) { drawDoubtOf(pose, accent); drawRobot(pose, accent, false); }
  if (view.fix) drawRobot(view.fix, '#d6336c', true);
  drawScale();
}

function drawScale() {
  const metres = niceLength(70 / view.scale);
  document.getElementById('scale-bar').style.width = `${metres * view.scale}px`;
  const text = metres < 1 ? `${Math.round(metres * 100)} cm` : `${metres} m`, shown = document.getElementById('scale-text');
  if (shown.textContent !== text) shown.textContent = text;
}
