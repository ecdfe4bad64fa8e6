// Pointer and keys.

const pointers = new Map();
let pressed = null; // where and when a press began that may become a click
let spread = 0;

canvas.addEventListener('pointerdown', (event) => {
  canvas.setPointerCapture(event.pointerId);
  canvas.focus({ preventScroll: true });
  pointers.set(event.pointerId, [event.clientX, event.clientY]);
  if (fixing && pointers.size === 1) {
    const [x, y] = toMap(event.clientX, event.clientY);
    view.fix = { x, y, theta: scene.pose?.theta ?? 0 };
    offerFix(false);
    redraw();
    return;
  }
  pressed = pointers.size === 1 ? { x: event.clientX, y: event.clientY, at: performance.now() } : null;
  spread = distance();
  canvas.classList.add('drag');
});

canvas.addEventListener('pointermove', (event) => {
  showWhere(event.clientX, event.clientY);
  const before = pointers.get(event.pointerId);
  if (!before) return;
  const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
  pointers.set(event.pointerId, [event.clientX, event.clientY]);
  if (fixing && view.fix && pointers.size === 1) {
    const [x, y] = toMap(event.clientX, event.clientY);
    if (Math.hypot(x - view.fix.x, y - view.fix.y) * view.scale > 8) view.fix.theta = Math.atan2(y - view.fix.y, x - view.fix.x);
    redraw();
    return;
  }
  if (pressed && Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y) < 5) return;
  pressed = null;
  setFollow(false);
  view.fitted = false;
  view.x -= dx / view.scale / pointers.size;
  view.y += dy / view.scale / pointers.size;
  if (pointers.size === 2) {
    const now = distance(), [a, b] = [...pointers.values()];
    if (spread) zoom(now / spread, (a[0] + b[0]) / 2, (a[1] + b[1]) / 2);
    spread = now;
  }
  redraw();
});

for (const kind of ['pointerup', 'pointercancel']) {
  canvas.addEventListener(kind, (event) => {
    pointers.delete(event.pointerId);
    spread = distance();
    canvas.classList.remove('drag');
    if (fixing && view.fix) { offerFix(true); return; }
    if (kind === 'pointerup' && pressed && performance.now() - pressed.at < 600) ask(event.clientX, event.clientY);
    pressed = null;
  });
}

canvas.addEventListener('pointerleave', () => { $('where').hidden = true; });
canvas.addEventListener('wheel', (event) => {
  event.preventDefault();
  const lines = event.deltaMode === 1 ? 16 : 1;
  zoom(Math.exp(-Math.max(-200, Math.min(200, event.deltaY * lines)) * 0.0016 * (event.ctrlKey ? 5 : 1)), event.clientX, event.clientY);
}, { passive: false });
canvas.addEventListener('contextmenu', (event) => event.preventDefault());

function distance() {
  const [a, b] = [...pointers.values()];
  return a && b ? Math.hypot(a[0] - b[0], a[1] - b[1]) : 0;
}

/** Coordinates under the pointer, and what the shown layer says there. */
function showWhere(px, py) {
  const [x, y] = toMap(px, py), level = levelAt(view.layer, x, y);
  const said = level === null ? 'unknown' : view.layer === 'doubt' ? `${(level / 100).toFixed(2)} m of error` : `p ${(1 - level / 255).toFixed(2)}`;
  $('where').hidden = false;
  $('where').replaceChildren(`${x.toFixed(2)}, ${y.toFixed(2)} m`, element('i', said));
}

const zoomMiddle = (factor) => zoom(factor, ...middle());

function setFollow(on) {
  view.follow = on;
  if (on) {
    view.fitted = false;
    if (view.scale < 30) view.scale = 45;
  }
  $('follow').setAttribute('aria-pressed', on);
  redraw();
}

function setBeams(on) {
  view.beams = on;
  $('beams').setAttribute('aria-pressed', on);
  redraw();
}

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  repaintTiles();
  showLegend();
  showChart();
}

function togglePanel() {
  const closed = document.body.classList.toggle('no-panel');
  $('handle').setAttribute('aria-expanded', !closed);
  redraw();
}

const KEYS = {
  '+': () => zoomMiddle(1.3), '=': () => zoomMiddle(1.3), '-': () => zoomMiddle(1 / 1.3), 0: () => { setFollow(false); fit(); },
  f: () => setFollow(!view.follow), b: () => setBeams(!view.beams), s: () => $('save').click(), ' ': () => $('pause').click(),
  x: () => $('fix').click(), n: () => $('theme').click(), p: togglePanel, '?': () => $('help').showModal(),
  1: () => choose('occupancy'), 2: () => choose('doubt'), 3: () => choose('sonar', scene.sonars[0]),
  Escape: () => { stopFixing(); closeCard(); },
  ArrowLeft: () => pan(-60, 0), ArrowRight: () => pan(60, 0), ArrowUp: () => pan(0, -60), ArrowDown: () => pan(0, 60),
  Enter: () => { if (!$('fix-send').disabled && fixing) $('fix-send').click(); },
};

function pan(dx, dy) {
  setFollow(false);
  view.fitted = false;
  view.x += dx / view.scale; view.y -= dy / view.scale;
  redraw();
}

addEventListener('keydown', (event) => {
  const typing = event.target.matches('input, textarea') && event.key !== 'Escape' && event.key !== 'Enter';
  const onButton = event.target.matches('button') && (event.key === ' ' || event.key === 'Enter');
  if (typing || onButton || event.ctrlKey || event.metaKey || event.altKey || $('help').open) return;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (!KEYS[key]) return;
  event.preventDefault();
  KEYS[key]();
});

$('zoom-in').onclick = () => zoomMiddle(1.4);
$('zoom-out').onclick = () => zoomMiddle(1 / 1.4);
$('fit').onclick = () => { setFollow(false); fit(); };
$('follow').onclick = () => setFollow(!view.follow);
$('beams').onclick = () => setBeams(!view.beams);
$('theme').onclick = () => { const theme = isNight() ? 'day' : 'night'; remember('theme', theme); setTheme(theme); };
$('help-open').onclick = () => $('help').showModal();
$('handle').onclick = togglePanel;

/** A choice that outlives the page, where the browser lets it. */
function remember(key, value) {
  try { localStorage.setItem(`echogrid.${key}`, value); } catch { /* private mode */ }
}

function remembered(key) {
  try { return localStorage.getItem(`echogrid.${key}`); } catch { return null; }
}
