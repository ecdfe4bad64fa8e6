// The connection, orders, and what comes of them.

let socket = null, connection = 'new', patience = 250, orders = 0;
const waiting = new Map(); // orders without an answer yet

function connect() {
  const url = new URL('socket', location.href);
  url.protocol = url.protocol.replace('http', 'ws');
  url.search = location.search;
  socket = new WebSocket(url);
  socket.binaryType = 'arraybuffer';
  socket.onopen = () => { connection = 'open'; patience = 250; tellLayer(); showState(connection); };
  socket.onmessage = ({ data }) => (typeof data === 'string' ? takeText(JSON.parse(data)) : takeSeen(takeBinary(data)));
  socket.onclose = () => {
    for (const done of waiting.values()) done({ ok: false, text: 'the connection was lost' });
    waiting.clear();
    connection = scene.greeted ? 'lost' : 'new';
    showState(connection);
    if (scene.ended) return;
    setTimeout(connect, patience);
    patience = Math.min(4000, patience * 1.6);
  };
}

function takeText(told) {
  switch (told.type) {
    case 'hello':
      if (scene.greeted && told.protocol !== protocolSeen) { location.reload(); return; }
      protocolSeen = told.protocol;
      scene.greeted = true;
      forgetScene();
      scene.facts = told.facts;
      text($('source'), told.facts.source || told.domain);
      document.title = `${told.facts.source || told.domain} · echogrid`;
      repaintTiles();
      break;
    case 'pose': scene.pose = told; later(showPose); redraw(); break;
    case 'map': scene.map = told; later(showVerdicts); later(showFigures); break;
    case 'health': scene.services = told.services; later(showProcesses); break;
    case 'log': told.lines.forEach(log); break;
    case 'layers': Object.assign(scene, { hasDoubt: told.doubt, sonars: told.sonars }); showLayers(); break;
    case 'answer': waiting.get(told.id)?.(told); waiting.delete(told.id); break;
    case 'ended': scene.ended = true; log({ time_s: Date.now() / 1000, service: 'graph', level: 'info', text: 'over; this is how it ended' }); break;
  }
  later(showStateNow);
}

let protocolSeen = null;
const showStateNow = () => showState(connection);

function takeSeen(seen) {
  if (seen?.kind === 'tiles') for (const tile of seen.tiles) paintTile(seen.name, tile);
  if (seen?.kind === 'trail') later(showChart);
  redraw();
}

/** Once for all that came since the last picture. */
const due = new Set();
function later(show) {
  if (!due.size) requestAnimationFrame(() => { const all = [...due]; due.clear(); all.forEach((one) => one()); });
  due.add(show);
}

/** Tells the service to do something; what it answers. */
function order(what) {
  return new Promise((resolve) => {
    if (socket?.readyState !== WebSocket.OPEN) { resolve({ ok: false, text: 'there is no connection' }); return; }
    const id = ++orders;
    waiting.set(id, resolve);
    socket.send(JSON.stringify({ ...what, id }));
  });
}

async function orderAndShow(what, button) {
  button.disabled = true;
  const { ok, text: answer } = await order(what);
  button.disabled = scene.ended;
  toast(answer, ok);
  log({ time_s: Date.now() / 1000, service: `you: ${what.do}`, level: ok ? 'you' : 'error', text: answer });
}

$('save').onclick = () => orderAndShow({ do: 'save' }, $('save'));
$('pause').onclick = () => orderAndShow({ do: scene.map?.is_held && !scene.map.is_degraded ? 'resume' : 'pause' }, $('pause'));

// A layer

function choose(layer, sonar) {
  const name = layer === 'sonar' ? `sonar ${sonar}` : layer;
  if ((layer === 'doubt' && !scene.hasDoubt) || (layer === 'sonar' && !scene.sonars.includes(sonar))) return;
  view.layer = name;
  tellLayer();
  showLayers();
  redraw();
}

/** Tiles of the layer that is shown, besides those of the map, are all that travel. */
function tellLayer() {
  const sonar = view.layer.match(/^sonar (\d+)$/);
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(sonar ? { do: 'layer', layer: 'sonar', sonar: Number(sonar[1]) } : { do: 'layer', layer: view.layer }));
}

$('layer-occupancy').onclick = () => choose('occupancy');
$('layer-doubt').onclick = () => choose('doubt');
$('layer-sonar').onclick = () => choose('sonar', scene.sonars[0]);

// A fix

let fixing = false;

$('fix').onclick = () => (fixing ? stopFixing() : startFixing());

function startFixing() {
  closeCard();
  fixing = true;
  view.fix = null;
  $('fix').setAttribute('aria-pressed', true);
  $('fix-bar').hidden = false;
  canvas.classList.add('fixing');
  if (innerWidth <= 760 && !document.body.classList.contains('no-panel')) togglePanel();
  offerFix(false);
}

function stopFixing() {
  fixing = false;
  view.fix = null;
  $('fix').setAttribute('aria-pressed', false);
  $('fix-bar').hidden = true;
  canvas.classList.remove('fixing');
  redraw();
}

function offerFix(ready) {
  $('fix-send').disabled = !ready;
  const { fix } = view;
  text($('fix-text'), fix ? `${fix.x.toFixed(2)}, ${fix.y.toFixed(2)} m, ${Math.round(degrees(fix.theta))}°` : 'Press where the robot is, and drag to where it looks.');
}

$('fix-cancel').onclick = stopFixing;
$('fix-send').onclick = async () => {
  const { x, y, theta } = view.fix, sigma = Number($('fix-sigma').value), heading = Number($('fix-heading').value);
  const said = { do: 'fix', x, y, theta, sigma_m: sigma, sigma_rad: heading * Math.PI / 180 };
  stopFixing();
  await orderAndShow(said, $('fix'));
};

// Why?

async function ask(px, py) {
  const r = scene.facts.resolution_m;
  if (!r) return;
  const [x, y] = toMap(px, py), cell = [(Math.floor(x / r) + 0.5) * r, (Math.floor(y / r) + 0.5) * r];
  const level = levelAt('occupancy', x, y), asked = { cell, readings: null, chosen: null };
  view.asked = asked;
  const state = level === null ? 'unknown' : level < 255 * 0.35 ? 'occupied' : level > 255 * 0.65 ? 'free' : 'undecided';
  text($('card-title'), state[0].toUpperCase() + state.slice(1) + (level === null ? '' : `, p = ${(1 - level / 255).toFixed(2)}`));
  const body = $('card-body');
  body.replaceChildren(element('p', `Cell at ${cell[0].toFixed(3)}, ${cell[1].toFixed(3)} m.`));
  placeCard(px, py);
  redraw();
  if (level === null) { body.append(element('p', 'No reading has touched it.')); return; }
  if (!scene.facts.keeps_readings) {
    const note = element('p', 'Which readings made it so is told where they are kept: start with ');
    note.append(element('code', '--set mapper.keep_readings=true'), '.');
    body.append(note);
    return;
  }
  const wait = element('p', 'Fusing the readings once more …');
  body.append(wait);
  const { ok, text: answer, why } = await order({ do: 'why', x: cell[0], y: cell[1] });
  if (view.asked !== asked) return;
  wait.remove();
  if (!ok) { body.append(element('p', answer)); return; }
  showWhy(body, asked, why);
  placeCard(px, py);
  redraw();
}

function showWhy(body, asked, why) {
  const signed = (number) => (number < 0 ? '−' : '+') + Math.abs(number).toFixed(2);
  const used = why.sensors.reduce((sum, sensor) => sum + sensor.readings, 0), refused = why.total - used;
  body.append(element('p', `${words(used)} readings moved it${refused ? `; ${words(refused)} that would have were refused` : ''}.`));
  const sensors = why.sensors.filter((sensor) => sensor.readings).map((sensor) => `${sensor.sensor} ${signed(sensor.added)} (${sensor.readings})`);
  if (sensors.length) body.append(element('p', sensors.join(' · ')));
  if (!why.is_exact) body.append(element('p', why.given_up ? `${words(why.given_up)} older readings are not among them.` : 'More has come in meanwhile.'));
  if (!why.readings.length) return;
  const table = element('table'), head = table.createTHead().insertRow(), rows = table.createTBody();
  for (const name of ['sensor', 'scan', 'range', 'weight', 'log-odds']) head.append(element('th', name));
  why.readings.forEach((reading, index) => {
    const row = rows.insertRow();
    const cells = [reading.sensor, words(reading.scan), reading.range_m == null ? 'no echo' : `${reading.range_m.toFixed(2)} m`,
      reading.is_used ? reading.weight.toFixed(2) : reading.verdict.replaceAll('_', ' '), reading.is_used ? signed(reading.added) : ''];
    for (const cell of cells) row.insertCell().textContent = cell;
    if (!reading.is_used) row.dataset.refused = '';
    row.onpointerenter = () => { asked.chosen = index; redraw(); };
    row.onpointerleave = () => { asked.chosen = null; redraw(); };
  });
  body.append(table);
  asked.readings = why.readings;
}

function placeCard(px, py) {
  const card = $('card');
  card.hidden = false;
  const { width, height } = card.getBoundingClientRect(), { right } = openArea();
  const left = px + 18 + width < right ? px + 18 : Math.max(12, px - 18 - width);
  card.style.left = `${left}px`;
  card.style.top = `${Math.max(12, Math.min(py - 24, innerHeight - height - 12))}px`;
}

function closeCard() {
  $('card').hidden = true;
  view.asked = null;
  redraw();
}

$('card-close').onclick = closeCard;

// Here it begins

$('ticks').innerHTML = Array.from({ length: 12 }, (_, at) => `<path d="M0 -44v${at % 3 ? 5 : 9}" transform="rotate(${at * 30})"/>`).join('');
document.documentElement.dataset.theme = remembered('theme') ?? (matchMedia('(prefers-color-scheme: dark)').matches ? 'night' : 'day');
if (innerWidth <= 760) togglePanel();
addEventListener('resize', () => { redraw(); showChart(); });
new ResizeObserver(() => { redraw(); showChart(); }).observe($('panel'));
showLayers();
showFigures();
showState(connection);
connect();
draw();
