// Figures beside the map.

const $ = (id) => document.getElementById(id);
const words = (number) => number.toLocaleString('en').replace(/,/g, '\u202f');
const degrees = (radians) => { const turn = radians * 180 / Math.PI; return ((turn % 360) + 360) % 360; };

function duration(seconds) {
  const whole = Math.max(0, Math.floor(seconds)), two = (n) => String(n).padStart(2, '0');
  const h = Math.floor(whole / 3600), m = Math.floor(whole / 60) % 60;
  return h ? `${h}:${two(m)}:${two(whole % 60)}` : `${m}:${two(whole % 60)}`;
}

/** A child for each item; children are kept, so that nothing flickers and a selection stays. */
function list(parent, items, make, fill) {
  while (parent.children.length > items.length) parent.lastElementChild.remove();
  items.forEach((item, index) => {
    const child = parent.children[index] ?? parent.appendChild(make());
    fill(child, item);
  });
}

function text(element, content) {
  if (element.textContent !== content) element.textContent = content;
}

function element(tag, content) {
  const made = document.createElement(tag);
  if (content != null) made.textContent = content;
  return made;
}

/** What the graph is about, in a word. */
function showState(connection) {
  const { pose, map, ended } = scene;
  const [kind, word] =
    ended ? ['', 'ended']
    : connection !== 'open' ? [connection === 'lost' ? 'bad' : 'wait', connection === 'lost' ? 'connection lost' : 'connecting']
    : scene.services.some((service) => service.state === 'failed') ? ['bad', 'a process failed']
    : map?.is_finished ? ['', 'map finished']
    : map?.is_unplaced || pose?.is_unplaced ? ['warn', 'waits for a place in the map']
    : map?.is_held ? ['warn', map.is_degraded || pose?.is_degraded ? 'held: degraded' : 'paused']
    : pose?.is_degraded ? ['warn', 'degraded']
    : pose ? ['good', 'mapping'] : ['wait', 'starting'];
  $('state').dataset.kind = kind;
  text($('state'), word);
  const held = Boolean(map?.is_held) && !map?.is_degraded;
  text($('pause').querySelector('span'), held ? 'Resume' : 'Pause');
  $('pause').querySelector('path').setAttribute('d', held ? 'M8 5.500v13l10.500-6.500z' : 'M8.500 5.500v13M15.500 5.500v13');
  for (const id of ['save', 'pause', 'fix']) $(id).disabled = ended || connection !== 'open';
}

function showPose() {
  const { pose, trail } = scene;
  if (!pose) return;
  text($('trust'), `${(pose.trust * 100).toFixed(pose.trust > 0.9995 ? 0 : 1)} %`);
  const first = trail.points[0]?.t ?? pose.stamp_s;
  text($('clock'), duration(pose.stamp_s - first));
  const heading = Math.round(degrees(pose.theta)) % 360;
  text($('heading'), `${heading}°`);
  // Counter-clockwise from east, as everywhere in the map.
  $('needle').setAttribute('transform', `rotate(${90 - degrees(pose.theta)})`);
  showFigures();
}

function showFigures() {
  const { pose, map, facts } = scene, area = (facts.resolution_m ?? 0) ** 2;
  const sigma = pose && Math.sqrt(Math.max(pose.covariance[0], pose.covariance[2]));
  const figures = [
    ['Position', pose && `${pose.x.toFixed(2)}, ${pose.y.toFixed(2)}`, 'm'],
    ['Standard deviation', pose && `${sigma < 1 ? (sigma * 100).toFixed(1) : sigma.toFixed(2)}`, `${sigma < 1 ? 'cm' : 'm'}, ${pose && (Math.sqrt(pose.covariance[3]) * 180 / Math.PI).toFixed(1)}°`],
    ['Way', pose && pose.distance_m.toFixed(1), 'm'],
    ['Since the last fix', pose && pose.travel_m.toFixed(1), 'm'],
    ['Known', map && (map.cells_known * area).toFixed(1), 'm²'],
    ['Occupied', map && (map.cells_occupied * area).toFixed(1), 'm²'],
    ['Scans', map && words(map.scans), ''],
    ['Fixes', pose && words(pose.fixes), pose?.refused ? `${words(pose.refused)} refused` : ''],
  ];
  const make = () => { const box = element('div'); box.append(element('dt'), element('dd')); box.lastChild.append(element('span'), ' ', element('small')); return box; };
  list($('figures'), figures, make, (box, [name, value, unit]) => {
    text(box.firstChild, name); text(box.lastChild.firstChild, value ?? '–'); text(box.lastChild.lastChild, value == null ? '' : unit);
  });
}

function showVerdicts() {
  const counts = [...(scene.map?.verdicts ?? [])].sort((a, b) => b[1] - a[1]), total = counts.reduce((sum, [, count]) => sum + count, 0);
  text($('readings-total'), total ? words(total) : '');
  list($('verdict-bar'), counts, () => element('i'), (bar, [code, count]) => {
    bar.style.background = verdictColour(code); bar.style.flex = `${count} 0 0`;
  });
  const make = () => { const row = element('li'); row.append(element('i'), element('b'), element('span')); return row; };
  list($('verdicts'), counts, make, (row, [code, count]) => {
    const verdict = scene.facts.verdicts?.[code];
    row.title = verdict?.text ?? '';
    row.children[0].style.background = verdictColour(code);
    text(row.children[1], (verdict?.name ?? `code ${code}`).replaceAll('_', ' '));
    const share = 100 * count / total;
    text(row.children[2], `${share < 0.05 ? '<0.1' : share.toFixed(1)} %`);
    row.title += ` (${words(count)})`;
  });
}

const rates = new Map();

function showProcesses() {
  const now = performance.now();
  const make = () => { const row = element('li'); row.append(element('i'), element('b'), element('em'), element('span')); return row; };
  list($('processes'), scene.services, make, (row, service) => {
    const past = rates.get(service.name);
    if (!past || past.pid !== service.pid) rates.set(service.name, { pid: service.pid, at: now, progress: service.progress, rate: null });
    else if (now - past.at > 900) Object.assign(past, { rate: (service.progress - past.progress) / (now - past.at) * 1000, at: now, progress: service.progress });
    const rate = rates.get(service.name)?.rate;
    row.children[0].dataset.state = service.state;
    text(row.children[1], service.name);
    const notes = [service.state === 'running' ? '' : service.state];
    if (service.restarts) notes.push(`${service.restarts}× restarted`);
    if (service.faults) notes.push(`${words(service.faults)} refused`);
    if (service.lost) notes.push(`${words(service.lost)} lost`);
    text(row.children[2], notes.filter(Boolean).join(', '));
    const running = service.state === 'running' && rate != null;
    text(row.children[3], running ? `${rate >= 10 ? words(Math.round(rate)) : rate.toFixed(1)} /s` : words(service.progress));
    row.title = `process ${service.pid}, ${words(service.progress)}${service.total ? ` of ${words(service.total)}` : ''} messages${service.waits_for ? `; waits for ${service.waits_for}` : ''}`;
    extra(row, 'progress', service.total > 0 && service.state === 'running', (bar) => { bar.max = service.total; bar.value = service.progress; });
    extra(row, 'u', Boolean(service.last_error), (error) => text(error, service.last_error));
  });
}

function extra(row, tag, wanted, fill) {
  let child = row.querySelector(tag);
  if (!wanted) { child?.remove(); return; }
  child ??= row.appendChild(element(tag));
  fill(child);
}

const LOG_SHOWN = 300;

function log(line) {
  const view = $('log'), atEnd = view.scrollHeight - view.scrollTop - view.clientHeight < 24;
  const row = element('li');
  row.dataset.level = line.level;
  const time = element('time', new Date(line.time_s * 1000).toLocaleTimeString('en-GB'));
  row.append(time, element('b', line.service), line.text);
  view.append(row);
  while (view.children.length > LOG_SHOWN) view.firstElementChild.remove();
  if (atEnd) view.scrollTop = view.scrollHeight;
}

function toast(words, ok) {
  const note = element('div', words);
  note.dataset.ok = ok;
  $('toasts').append(note);
  setTimeout(() => note.remove(), ok ? 3500 : 7000);
}

// Trust over time

function showChart() {
  const chart = $('chart'), box = chart.getBoundingClientRect();
  if (!box.width) return;
  const [width, height] = [box.width, box.height].map((side) => Math.round(side * devicePixelRatio));
  if (chart.width !== width || chart.height !== height) Object.assign(chart, { width, height });
  const pen = chart.getContext('2d'), style = getComputedStyle(document.documentElement), ink = style.getPropertyValue('--soft');
  pen.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
  pen.clearRect(0, 0, box.width, box.height);
  const [left, right, top, bottom] = [26, box.width, 6, box.height - 14];
  const y = (trust) => bottom - trust * (bottom - top);
  pen.font = '10px system-ui, sans-serif'; pen.fillStyle = ink; pen.strokeStyle = style.getPropertyValue('--faint');
  pen.textAlign = 'right'; pen.textBaseline = 'middle'; pen.lineWidth = 1;
  for (const trust of [0, 0.5, 1]) {
    pen.fillText(`${trust * 100}`, left - 6, y(trust));
    pen.beginPath(); pen.moveTo(left, Math.round(y(trust)) + 0.5); pen.lineTo(right, Math.round(y(trust)) + 0.5); pen.stroke();
  }
  const { points } = scene.trail, { pose } = scene;
  if (!points.length) return;
  const from = points[0].t, to = Math.max(pose?.stamp_s ?? 0, points[points.length - 1].t, from + 1);
  const x = (t) => left + (t - from) / (to - from) * (right - left);
  pen.textBaseline = 'alphabetic'; pen.textAlign = 'left'; pen.fillText('0:00', left, box.height - 2);
  pen.textAlign = 'right'; pen.fillText(duration(to - from), right, box.height - 2);
  // Lowest and highest of each column of pixels: a dip is never thinned away.
  const columns = [];
  for (const point of [...points, ...(pose ? [{ t: pose.stamp_s, trust: pose.trust }] : [])]) {
    const column = Math.round(x(point.t)), last = columns[columns.length - 1];
    if (last?.column === column) { last.low = Math.min(last.low, point.trust); last.high = Math.max(last.high, point.trust); last.end = point.trust; }
    else columns.push({ column, low: point.trust, high: point.trust, end: point.trust });
  }
  const accent = style.getPropertyValue('--accent');
  pen.beginPath();
  columns.forEach(({ column, low, high, end }, index) => {
    if (index) pen.lineTo(column, y(high)); else pen.moveTo(column, y(high));
    pen.lineTo(column, y(low)); pen.lineTo(column, y(end));
  });
  pen.strokeStyle = accent; pen.lineWidth = 1.5; pen.lineJoin = 'round'; pen.stroke();
  pen.lineTo(columns[columns.length - 1].column, bottom); pen.lineTo(columns[0].column, bottom); pen.closePath();
  pen.globalAlpha = 0.12; pen.fillStyle = accent; pen.fill(); pen.globalAlpha = 1;
}

// Layers

function showLayers() {
  $('layer-occupancy').setAttribute('aria-checked', view.layer === 'occupancy');
  $('layer-doubt').setAttribute('aria-checked', view.layer === 'doubt');
  $('layer-sonar').setAttribute('aria-checked', view.layer.startsWith('sonar'));
  $('layer-doubt').disabled = !scene.hasDoubt;
  $('layer-sonar').disabled = !scene.sonars.length;
  $('layer-doubt').title = scene.hasDoubt ? 'How much odometry error the evidence of each cell carried (2)' : 'Not kept: start with --set mapper.doubt=true';
  $('layer-sonar').title = scene.sonars.length ? 'What one sonar alone says (3)' : 'Not kept: start with --set mapper.sonar_maps=true';
  $('sonars').hidden = !view.layer.startsWith('sonar');
  list($('sonars'), scene.sonars, () => element('button'), (button, sonar) => {
    text(button, String(sonar));
    button.setAttribute('aria-pressed', view.layer === `sonar ${sonar}`);
    button.onclick = () => choose('sonar', sonar);
  });
  showLegend();
}

function showLegend() {
  const strip = $('ramp').getContext('2d'), colours = palette(view.layer), doubt = view.layer === 'doubt';
  for (let at = 0; at < 96; at++) {
    const level = doubt ? Math.round(at / 95 * 100 * DOUBT_MAX_M) : Math.round(255 - at / 95 * 255);
    strip.fillStyle = `rgb(${colours[level].join()})`;
    strip.fillRect(at, 0, 1, 8);
  }
  text($('ramp-low'), doubt ? '0' : 'free');
  text($('ramp-high'), doubt ? `≥ ${DOUBT_MAX_M} m of error` : 'occupied');
}
