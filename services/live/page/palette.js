// Colours: by day those of map.png, by night the same reading with light for what is there.

const VERDICTS = {
  accepted: '#0b9a68', no_echo: '#4d9de0', untrusted: '#d79a00', held: '#9277e6', no_pose: '#b26fd0', off_map: '#7f8c9b',
  stuck: '#d9480f', lone: '#f0702a', multiple_reflection: '#e03131', invalid: '#7f8c9b', below_minimum: '#8fa0b3',
  above_maximum: '#8fa0b3', not_selected: '#aab6c3',
};

const isNight = () => document.documentElement.dataset.theme === 'night';

/** A ramp of 256 colours through the given ones. */
function ramp(stops) {
  const colours = [];
  for (let level = 0; level < 256; level++) {
    const at = level / 255 * (stops.length - 1), low = Math.min(Math.floor(at), stops.length - 2), part = at - low;
    colours.push(stops[low].map((from, channel) => Math.round(from + part * (stops[low + 1][channel] - from))));
  }
  return colours;
}

const GREYS = Array.from({ length: 256 }, (_, level) => [level, level, level]);
// Level 0 is occupied, 255 free.
const NIGHT = ramp([[250, 247, 238], [196, 199, 201], [112, 124, 138], [62, 75, 90], [38, 48, 60]]);
// Blue where the evidence carried little error, through yellow to red.
const DOUBTS = ramp([[54, 92, 166], [64, 150, 178], [138, 192, 152], [232, 206, 110], [226, 133, 67], [178, 40, 48]]);

/** Levels of the doubt layer are centimetres; the ramp ends here, metres. */
const DOUBT_MAX_M = 1;

function palette(name) {
  if (name === 'doubt') return Array.from({ length: 256 }, (_, level) => DOUBTS[Math.min(255, Math.round(level / 100 / DOUBT_MAX_M * 255))]);
  return isNight() ? NIGHT : GREYS;
}

const unknownColour = () => (isNight() ? [12, 17, 23] : [188, 198, 210]);

/** From trusted to not: of the path. */
const TRUSTS = ramp([[214, 69, 65], [226, 148, 30], [44, 110, 220]]);
const trustColour = (trust) => `rgb(${TRUSTS[Math.max(0, Math.min(255, Math.round(trust * 255)))].join()})`;

function verdictColour(code) {
  return VERDICTS[scene.facts.verdicts?.[code]?.name] ?? '#7f8c9b';
}
