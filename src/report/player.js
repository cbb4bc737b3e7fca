// Plays a motion: { times, points: flat x, y of the nodes at each time, com, body: semi-axes and angle of a body around the first node,
// if any, beside: [{ name, points }] of other rods }. Call start once, play for every motion.
let motion = null, playing = true, now = 0, last = null, world = null, near = null;
// The picture is drawn in units of the window's size, not in metres: browsers do not draw shapes of a few micrometres.
const WINDOW = 1000;
let unit = 1;
const part = (id) => document.getElementById(id);
const pairs = (flat) => { let text = ""; for (let i = 0; i < flat.length; i += 2) text += unit * flat[i] + "," + -unit * flat[i + 1] + " "; return text; };
const empty = () => ({ left: Infinity, right: -Infinity, low: Infinity, high: -Infinity });
function widen(box, x, y) {
  box.left = Math.min(box.left, x); box.right = Math.max(box.right, x); box.low = Math.min(box.low, y); box.high = Math.max(box.high, y);
}
// A window that holds a box with a margin, and is not too narrow.
function framed(box) {
  const size = Math.max(box.right - box.left, box.high - box.low, 1e-12), edge = 0.06 * size, least = 0.15 * size;
  const middle = (box.low + box.high) / 2, half = Math.max((box.high - box.low) / 2, least) + edge;
  return { left: box.left - edge, right: box.right + edge, low: middle - half, high: middle + half, size };
}
// A length in the unit that suits it.
function length(x) {
  const scale = [[0.1, "m", 1], [1e-3, "mm"], [1e-6, "µm"], [1e-9, "nm"]].find(([size]) => x >= 0.999 * size) ?? [1e-9, "nm"];
  return Number((x / (scale[2] ?? scale[0])).toPrecision(1)) + "\u00a0" + scale[1];
}
function play(wanted) {
  motion = wanted;
  // What holds every frame, y upwards; and what holds each about its centre of mass.
  world = empty(); near = empty();
  motion.points.forEach((frame, k) => {
    for (const points of [frame, ...motion.beside.map((other) => other.points[k])]) for (let i = 0; i < points.length; i += 2) {
      widen(world, points[i], points[i + 1]); widen(near, points[i] - motion.com[k][0], points[i + 1] - motion.com[k][1]);
    }
    if (motion.body) for (const reach of [-1, 1]) {
      const r = reach * Math.max(motion.body[k][0], motion.body[k][1]), [x, y] = [frame[0] + r, frame[1] + r];
      widen(world, x, y); widen(near, x - motion.com[k][0], y - motion.com[k][1]);
    }
  });
  world = framed(world); near = framed(near);
  // To follow is worth while where the rod comes far; and a run is shown in about ten seconds.
  part("follow").checked = world.size > 2.5 * near.size;
  const [first, end] = [motion.times[0], motion.times[motion.times.length - 1]];
  const speeds = [...part("speed").options].map((option) => Number(option.value));
  const apart = (speed) => Math.abs(Math.log(speed * 10 / Math.max(end - first, 1e-12)));
  const usual = end - first > 2 && end - first < 40 ? 1 : speeds.reduce((a, b) => apart(b) < apart(a) ? b : a);
  part("speed").value = String(usual);
  part("time").max = motion.times.length - 1;
  part("stage").dataset.frames = motion.times.length;
  const lines = motion.beside.map((other, i) => {
    const line = document.createElementNS("http://www.w3.org/2000/svg", "polyline");
    line.setAttribute("vector-effect", "non-scaling-stroke"); if (other.name) line.setAttribute("style", "stroke: " + coloured(i));
    return line;
  });
  part("beside").replaceChildren(...lines);
  named(motion.media);
  now = first; playing = motion.times.length > 1 && !matchMedia("(prefers-reduced-motion: reduce)").matches; part("play").textContent = playing ? "Pause" : "Play";
  show(0);
}
// Moves the camera to the whole way, or along with the centre of mass; the grid stands still in the world.
function look(com) {
  const follow = part("follow").checked, box = follow ? near : world, [x, y] = follow ? com : [0, 0];
  unit = WINDOW / box.size;
  const view = { left: unit * (box.left + x), right: unit * (box.right + x), low: unit * (box.low + y), high: unit * (box.high + y) };
  part("stage").setAttribute("viewBox", [view.left, -view.high, view.right - view.left, view.high - view.low].join(" "));
  part("stage").dataset.follow = follow;
  const metres = Math.pow(10, Math.floor(Math.log10(box.size / 2))), square = unit * metres;
  part("square").textContent = length(metres);
  const lines = [];
  const line = (x1, y1, x2, y2) => lines.push("M" + x1 + " " + -y1 + "L" + x2 + " " + -y2);
  // Over the sides of the window, too, where the picture is wider or higher than it.
  const [wide, high] = [view.right - view.left, view.high - view.low].map((size) => 2 * size);
  for (let x = Math.ceil((view.left - wide) / square); x <= (view.right + wide) / square; x += 1) line(x * square, view.low - high, x * square, view.high + high);
  for (let y = Math.ceil((view.low - high) / square); y <= (view.high + high) / square; y += 1) line(view.left - wide, y * square, view.right + wide, y * square);
  const behind = { x: view.left - wide, y: -view.high - high, width: 2 * wide + view.right - view.left, height: 2 * high + view.high - view.low };
  for (const name in behind) part("media").setAttribute(name, behind[name]);
  let path = part("grid").firstChild;
  if (!path) {
    path = document.createElementNS("http://www.w3.org/2000/svg", "path");
    path.setAttribute("vector-effect", "non-scaling-stroke"); part("grid").append(path);
  }
  path.setAttribute("d", lines.join(""));
  part("head").setAttribute("r", 0.011 * WINDOW); part("com").setAttribute("r", 0.008 * WINDOW);
}
// The media behind the rod: one rectangle over the window, whose gradient blends where the interfaces do.
function within(k) {
  const media = motion.media, edges = media.moved ? media.moved[k] : media.edges, [x, y] = media.normal;
  const low = edges[0][0], high = edges[edges.length - 1][1], blend = part("blend");
  for (const [name, value] of [["x1", x * low], ["y1", -y * low], ["x2", x * high], ["y2", -y * high]]) blend.setAttribute(name, unit * value);
  const stops = edges.flatMap((ends, j) => ends.map((end, side) => [(end - low) / (high - low), media.tints[j + side]]));
  blend.replaceChildren(...stops.map(([offset, tint]) => {
    const stop = document.createElementNS("http://www.w3.org/2000/svg", "stop");
    stop.setAttribute("offset", offset); stop.setAttribute("style", "stop-color: var(--medium-" + tint + ")");
    return stop;
  }));
}
// What the tints mean, in the order of the media along the normal.
function named(media) {
  part("media").setAttribute("display", media ? "inline" : "none");
  const entry = (name, colour) => {
    const swatch = document.createElement("span"), text = document.createElement("span");
    swatch.className = "swatch"; swatch.style.background = colour; text.textContent = name.replaceAll(" ", "\u00a0");
    return [swatch, text];
  };
  const layers = media ? ["Media:", ...media.names.flatMap((name, i) => entry(name, "var(--medium-" + media.tints[i] + ")"))] : [];
  const beside = motion.beside.flatMap((other, i) => other.name ? entry(other.name, coloured(i)) : []);
  part("legend").replaceChildren(...layers, ...(beside.length ? [" Beside it, from above:", ...beside] : []));
}
// Colours that are neither the rod's nor its centre's, as charts have them.
function coloured(i) { return "var(--companion-" + i % 6 + ")"; }
function show(k) {
  const frame = motion.points[k], com = motion.com[k];
  look(com);
  if (motion.media) within(k);
  part("rod").setAttribute("points", pairs(frame));
  motion.beside.forEach((other, i) => part("beside").children[i].setAttribute("points", pairs(other.points[k])));
  part("trace").setAttribute("points", pairs(motion.com.slice(0, k + 1).flat()));
  part("head").style.display = motion.body ? "none" : ""; part("body").style.display = motion.body ? "" : "none";
  if (motion.body) {
    const [along, across, angle] = motion.body[k];
    part("body").setAttribute("rx", unit * along); part("body").setAttribute("ry", unit * across);
    part("body").setAttribute("transform", "translate(" + unit * frame[0] + "," + -unit * frame[1] + ") rotate(" + -angle * 180 / Math.PI + ")");
  }
  part("head").setAttribute("cx", unit * frame[0]); part("head").setAttribute("cy", -unit * frame[1]);
  part("com").setAttribute("cx", unit * com[0]); part("com").setAttribute("cy", -unit * com[1]);
  const end = motion.times[motion.times.length - 1], digits = Math.min(9, Math.max(0, 3 - Math.floor(Math.log10(end || 1))));
  part("time").value = k; part("clock").textContent = "t = " + motion.times[k].toFixed(digits) + " s";
  part("stage").dataset.frame = k;
}
function at(time) { let a = 0, b = motion.times.length - 1; while (a < b) { const m = (a + b + 1) >> 1; if (motion.times[m] <= time) a = m; else b = m - 1; } return a; }
function tick(stamp) {
  if (playing && last !== null) {
    now += (stamp - last) / 1000 * Number(part("speed").value);
    if (now > motion.times[motion.times.length - 1]) now = motion.times[0];
    show(at(now));
  }
  last = stamp; requestAnimationFrame(tick);
}
part("play").onclick = () => { playing = !playing; part("play").textContent = playing ? "Pause" : "Play"; };
part("time").oninput = () => { playing = false; part("play").textContent = "Play"; const k = Number(part("time").value); now = motion.times[k]; show(k); };
part("follow").onchange = () => show(Number(part("time").value));
function start() { requestAnimationFrame(tick); }
