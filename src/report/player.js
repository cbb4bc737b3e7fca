// Plays a motion of page.rs: { times, com, the rod, beside: other rods, and where they are known period: of the fastest drive, media, flow, moment, power and head_force }.
// A rod is { series: its colour, points: packed x, y of the nodes at all times, relative to com, joints, and where they are known name,
// half_widths, body: semi-axes of a body around the first point, head, tendons }. Call start once, play for every motion.
let stage_view = null;
let motion = null, playing = true, now = 0, clock_digits = 3, last = null, world = null, near = null;
// The picture is drawn in units of the window's size, not in metres: browsers do not draw shapes of a few micrometres.
const WINDOW = 1000;
let unit = 1, origin = [0, 0];
// Places in units of the picture about the middle of the window, whose axis y goes down: far from where x and y are 0, too.
const at_x = (x) => unit * (x - origin[0]), at_y = (y) => -unit * (y - origin[1]);
const part = (id) => document.getElementById(id);
const pairs = (flat) => { let text = ""; for (let i = 0; i < flat.length; i += 2) text += at_x(flat[i]) + "," + at_y(flat[i + 1]) + " "; return text; };
const SVG = "http://www.w3.org/2000/svg";
const shape = (kind, attributes) => { const node = document.createElementNS(SVG, kind); for (const name in attributes) node.setAttribute(name, attributes[name]); return node; };
// Packed numbers, of which so many belong to each frame.
function unpacked(text, frames) {
  const all = new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer), each = all.length / frames;
  return Array.from({ length: frames }, (_, k) => all.subarray(k * each, (k + 1) * each));
}
// Numbers as whole parts of a size.
function shades({ size, parts }, frames) {
  const all = Float32Array.from(atob(parts), (c) => ((c.charCodeAt(0) << 24) >> 24) / 127 * size), each = all.length / frames;
  return Array.from({ length: frames }, (_, k) => all.subarray(k * each, (k + 1) * each));
}
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
// A motion whose numbers are unpacked; one that was played is already.
function unpack(wanted) {
  const frames = wanted.times.length;
  if (typeof wanted.points === "string") {
    const placed = (text) => unpacked(text, frames).map((frame, k) => Float64Array.from(frame, (value, i) => value + wanted.com[k][i % 2]));
    wanted.points = placed(wanted.points);
    wanted.beside.forEach((other) => { other.points = placed(other.points); });
    if (wanted.head_force) wanted.head_force = unpacked(wanted.head_force, frames);
    // A flow that is constant has one velocity.
    if (wanted.flow) wanted.flow.layers = wanted.flow.layers.map((text) => { const all = unpacked(text, 1)[0]; return all.length > 2 ? unpacked(text, frames) : Array(frames).fill(all); });
    for (const name of ["moment", "power"]) if (wanted[name]) wanted[name] = shades(wanted[name], frames);
  }
  return wanted;
}
// Screens draw so many pictures per second, of which a period (s) of the fastest drive needs as many as in sampling.rs.
const SCREEN_RATE = 60, LEAST_PER_PERIOD = 12;
// The speeds of the list at which the beat looks as it is, or the lowest one.
function usual_speeds(period) {
  const all = [...part("speed").options].map((option) => Number(option.value)), most = period * SCREEN_RATE / LEAST_PER_PERIOD * (1 + 1e-6);
  return all.filter((speed) => speed <= Math.max(most, Math.min(...all)));
}
// The digits after the point of a clock that tells frames apart, with at least four for the length of the window.
function clock_digits_of(times) {
  const span = times[times.length - 1] - times[0], spacing = span / Math.max(times.length - 1, 1);
  return span > 0 ? Math.min(12, Math.max(0, 3 - Math.floor(Math.log10(span)), Math.ceil(-Math.log10(spacing)))) : 3;
}
function play(wanted) {
  motion = unpack(wanted);
  fields = {};
  // What holds every frame, y upwards; and what holds each about its centre of mass.
  world = empty(); near = empty();
  motion.points.forEach((frame, k) => {
    for (const points of [frame, ...motion.beside.map((other) => other.points[k])]) for (let i = 0; i < points.length; i += 2) {
      widen(world, points[i], points[i + 1]); widen(near, points[i] - motion.com[k][0], points[i + 1] - motion.com[k][1]);
    }
    for (const rod of [motion, ...motion.beside]) if (rod.body) for (const reach of [-1, 1]) {
      const r = reach * Math.max(...rod.body), [x, y] = [rod.points[k][0] + r, rod.points[k][1] + r];
      widen(world, x, y); widen(near, x - motion.com[k][0], y - motion.com[k][1]);
    }
  });
  world = framed(world); near = framed(near);
  // To follow is worth while where the rod comes far. A run is shown in about ten seconds, but with enough pictures per period.
  part("follow").checked = world.size > 2.5 * near.size;
  const [first, end] = [motion.times[0], motion.times[motion.times.length - 1]];
  const speeds = usual_speeds(motion.period ?? Infinity);
  const apart = (speed) => Math.abs(Math.log(speed * 10 / Math.max(end - first, 1e-12)));
  const usual = end - first > 2 && end - first < 40 && speeds.includes(1) ? 1 : speeds.reduce((a, b) => apart(b) < apart(a) ? b : a);
  part("speed").value = String(usual);
  clock_digits = clock_digits_of(motion.times);
  part("time").max = motion.times.length - 1;
  part("stage").dataset.frames = motion.times.length;
  part("beside").replaceChildren(...motion.beside.map((other) => {
    const rod = shape("g", { class: other.series < SERIES_COLOURS ? "" : "dashed", style: "stroke: " + colour_of(other) + "; fill: " + colour_of(other) });
    rod.append(...["polygon", "ellipse", "polyline"].map((kind) => shape(kind, { "vector-effect": "non-scaling-stroke", "stroke-width": 1.2 })));
    return rod;
  }));
  part("tendons").replaceChildren(...(motion.tendons ?? []).map(() => shape("polyline", { "vector-effect": "non-scaling-stroke" })));
  part("segments").replaceChildren(...Array.from({ length: motion.points[0].length / 2 - 1 }, () => shape("polygon", { "vector-effect": "non-scaling-stroke" })));
  for (const option of part("colour").options) option.disabled = option.hidden = !(option.value in FIELDS ? FIELDS[option.value].of(0) : true);
  if (part("colour").selectedOptions[0].disabled) part("colour").value = "body";
  part("stage").style.setProperty("--rod", colour_of(motion));
  largest = { force: most(motion.head_force), flow: most_flow() };
  force_scale = usual_size((motion.head_force ?? []).map(([x, y]) => Math.hypot(x, y)));
  named(motion.media);
  part("motion-note").textContent = motion.note ?? "";
  // What the page's own address asked for is of what it shows first.
  const wanted_time = within_run(first_asked); first_asked = null;
  now = wanted_time ?? first; playing = wanted_time === null && motion.times.length > 1 && !matchMedia("(prefers-reduced-motion: reduce)").matches; part("play").textContent = playing ? "Pause" : "Play";
  show(at(now));
}
// What the address asks for, as "t" of #t=1.5&colour=moment.
function asked(name) { return new URLSearchParams(location.hash.slice(1)).get(name); }
function within_run(time) { return time === null || !Number.isFinite(Number(time)) ? null : Math.min(Math.max(Number(time), motion.times[0]), motion.times[motion.times.length - 1]); }
// The address of the frame that is seen, with two more digits than the clock; where a page has no address of its own, as in a notebook, there is none.
function address() {
  try { history.replaceState(null, "", "#t=" + Number(motion.times[at(now)].toFixed(clock_digits + 2)) + (part("colour").value === "body" ? "" : "&colour=" + part("colour").value)); } catch { /* it has none */ }
}

// Quantities along the rod that colour it, each with its unit and its values in a frame.
const FIELDS = {
  curvature: { unit: "1/m", of: (k) => curvature(motion.points[k]), joints: () => [1, motion.points[0].length / 2 - 2] },
  moment: { unit: "N m", of: (k) => motion.moment?.[k], joints: () => motion.joints },
  power: { unit: "W/m", of: (k) => motion.power?.[k], joints: () => motion.joints },
};
const DIVERGING = [{% for colour in diverging %}[{{ colour|join(", ") }}], {% endfor %}];
let first_asked = asked("t");
let fields = {}, largest = {}, force_scale = 0;
// The size of a scale that all but a hundredth of the values stay within, if the largest, as that of a start, is far beyond; else that.
function usual_size(sizes) {
  const sorted = Float64Array.from(sizes).sort(), most = sorted[sorted.length - 1] ?? 0, within = sorted[Math.floor(0.99 * (sorted.length - 1))] ?? 0;
  return most > 4 * within && within > 0 ? within : most;
}
// The velocity of the flow at a time in a layer, with that of a shear at a place.
function flow_in(k, layer, x, y) {
  const { layers, rate = 0, normal: [nx, ny] = [0, 0] } = motion.flow, [u, v] = layers[Math.min(layer, layers.length - 1)][k], shear = rate * (x * nx + y * ny);
  return [u + shear * ny, v - shear * nx];
}
// The largest speed of the flow that may be seen; none where the flow is not known.
function most_flow() {
  const corners = [[world.left, world.low], [world.left, world.high], [world.right, world.low], [world.right, world.high]];
  return motion.flow ? most(motion.times.flatMap((_, k) => motion.flow.layers.flatMap((_, j) => corners.map(([x, y]) => flow_in(k, j, x, y))))) : 0;
}
const most = (vectors) => Math.max(0, ...(vectors ?? []).map(([x, y]) => Math.hypot(x, y)));
function curvature(points) {
  const values = new Float64Array(points.length / 2);
  for (let i = 1; i + 1 < values.length; i++) {
    const [ax, ay, bx, by] = [points[2 * i] - points[2 * i - 2], points[2 * i + 1] - points[2 * i - 1], points[2 * i + 2] - points[2 * i], points[2 * i + 3] - points[2 * i + 1]];
    values[i] = 4 * Math.tan(Math.atan2(ax * by - ay * bx, ax * bx + ay * by) / 2) / (Math.hypot(ax, ay) + Math.hypot(bx, by));
  }
  return values;
}
// The size of a field that has the strongest colours.
function size_of(name) {
  return fields[name] ??= usual_size(motion.times.flatMap((_, k) => Array.from(FIELDS[name].of(k), Math.abs)));
}
// A colour between blue for -1, white for 0 and red for 1.
function diverging(x) {
  const place = Math.min(Math.max((x + 1) / 2, 0), 1) * (DIVERGING.length - 1), low = Math.min(Math.floor(place), DIVERGING.length - 2);
  return "rgb(" + DIVERGING[low].map((from, c) => Math.round(from + (place - low) * (DIVERGING[low + 1][c] - from))).join(",") + ")";
}
// The points of a line beside the rod, at a distance to its left seen from the head, in units of the picture.
function offset(points, distance) {
  const count = points.length / 2, line = [];
  for (let i = 0; i < count; i++) {
    const [a, b] = [Math.max(i - 1, 0), Math.min(i + 1, count - 1)];
    const [x, y] = [points[2 * b] - points[2 * a], points[2 * b + 1] - points[2 * a + 1]], long = Math.hypot(x, y) || 1, d = distance(i);
    line.push([at_x(points[2 * i]) - d * y / long, at_y(points[2 * i + 1]) - d * x / long]);
  }
  return line;
}
const text_of = (line) => line.map(([x, y]) => x + "," + y).join(" ");
// The outline of a body with these half widths; empty if they are not known, or too small to be seen.
function outline_of(points, widths) {
  if (!widths || !(Math.max(...widths) * unit > 2 * pixel())) return "";
  const half = (i) => unit * widths[i];
  return text_of([...offset(points, half), ...offset(points, (i) => -half(i)).reverse()]);
}
// Places the ellipse of a body at the head, if there is one, along the first edge.
function place_body(ellipse, body, points) {
  ellipse.style.display = body ? "" : "none";
  if (!body) return;
  const [along, across] = body, angle = Math.atan2(points[3] - points[1], points[2] - points[0]);
  ellipse.setAttribute("rx", unit * along); ellipse.setAttribute("ry", unit * across);
  ellipse.setAttribute("transform", "translate(" + at_x(points[0]) + "," + at_y(points[1]) + ") rotate(" + -angle * 180 / Math.PI + ")");
}
// The body with its widths, by one colour or by the colours of a field.
function dress(k, points) {
  const widths = motion.half_widths;
  const half = (i) => unit * (widths ? widths[i] : 0), name = part("colour").value, coloured = name in FIELDS;
  const outline = outline_of(points, widths);
  part("outline").style.display = outline ? "" : "none"; part("segments").style.display = coloured ? "" : "none";
  part("outline").style.fill = coloured ? "none" : "";
  part("rod").setAttribute("stroke-width", coloured ? 0 : outline ? 1.5 : 4);
  part("outline").setAttribute("points", outline);
  // Dots are no wider than the body or, where that is a line, hardly wider than the line.
  const widest = outline ? unit * Math.max(...widths) : 3 * pixel();
  part("head").setAttribute("r", Math.min(0.011 * WINDOW, widest)); part("com").setAttribute("r", Math.min(0.008 * WINDOW, widest));
  if (coloured) {
    const seen = (i) => Math.max(half(i), 2.5 * pixel()), [left, right] = [offset(points, seen), offset(points, (i) => -seen(i))];
    const values = FIELDS[name].of(k), size = size_of(name) || 1, [first, last] = FIELDS[name].joints();
    // An end without a joint has no value of its own.
    const value = (i) => values[Math.max(first, Math.min(i, last))];
    [...part("segments").children].forEach((segment, i) => {
      segment.setAttribute("points", text_of([left[i], left[i + 1], right[i + 1], right[i]]));
      const colour = diverging((value(i) + value(i + 1)) / 2 / size);
      segment.setAttribute("fill", colour); segment.setAttribute("stroke", colour);
    });
  }
  (motion.tendons ?? []).forEach(({ offset: distance, points: [from, to] }, i) =>
    part("tendons").children[i].setAttribute("points", text_of(offset(points, () => unit * distance).slice(from, to + 1))));
}
// An arrow from a point, both in units of the picture.
function arrow(x, y, dx, dy) {
  const long = Math.hypot(dx, dy), [ux, uy] = [dx / long, dy / long], tip = Math.min(0.3 * long, 0.02 * WINDOW);
  const back = (side) => (x + dx - tip * (ux + side * uy)) + " " + (y + dy - tip * (uy - side * ux));
  return long > 0 ? "M" + x + " " + y + "l" + dx + " " + dy + "M" + back(0.5) + "L" + (x + dx) + " " + (y + dy) + "L" + back(-0.5) : "";
}
// How the head is held, and the force of the tail on it.
function hold(k, points) {
  const angle = Math.atan2(points[3] - points[1], points[2] - points[0]), size = 0.03 * WINDOW, [x, y] = [at_x(points[0]), at_y(points[1])];
  const lines = {
    clamped: "M0 -1V1M0 -1l-.4 .4M0 -.5l-.4 .4M0 0l-.4 .4M0 .5l-.4 .4M0 1l-.4 .4", driven: "M0 -.7H-.7V.7H0Z", hinged: "M.35 0A.35 .35 0 1 1 .349 -.01M0 .35L-.5 1H.5Z",
  };
  const turn = motion.head === "hinged" ? 0 : -angle * 180 / Math.PI;
  part("holder").setAttribute("d", lines[motion.head] ?? "");
  part("holder").setAttribute("transform", "translate(" + x + "," + y + ") rotate(" + turn + ") scale(" + size + ")");
  const force = motion.head_force?.[k], size_of_force = force ? Math.hypot(...force) : 0, long = 0.16 * WINDOW * Math.min(1 / force_scale, 1.5 / size_of_force);
  part("force").setAttribute("d", size_of_force > 0 ? arrow(x, y, long * force[0], -long * force[1]) : "");
}
// The velocity of the fluid, relative to the largest, at places that stay in the window.
function stream(k, view) {
  const long = 0.07 * WINDOW / largest.flow, arrows = [], media = motion.media, edges = media?.moved?.[k] ?? media?.edges ?? [];
  const layer_at = (x, y) => 1 + edges.findLastIndex(([from, to]) => x * media.normal[0] + y * media.normal[1] > (from + to) / 2);
  if (largest.flow > 0) for (let i = 0; i < 5; i++) for (let j = 0; j < 3; j++) {
    const x = view.left + (0.06 + 0.2 * i) * (view.right - view.left), y = view.low + (0.2 + 0.3 * j) * (view.high - view.low);
    const at = [x / unit + origin[0], y / unit + origin[1]], [ux, uy] = flow_in(k, layer_at(...at), ...at);
    arrows.push(arrow(x, -y, long * ux, -long * uy));
  }
  part("stream").setAttribute("d", arrows.join(""));
}
// Moves the camera to the whole way, or along with the centre of mass; the grid stands still in the world.
// Units of the picture per pixel of the window.
function pixel() {
  const view = part("stage").viewBox.baseVal, { clientWidth, clientHeight } = part("stage");
  return clientWidth && clientHeight ? Math.max(view.width / clientWidth, view.height / clientHeight) : view.width / WINDOW;
}
function look(com) {
  const follow = part("follow").checked, box = follow ? near : world, [x, y] = follow ? com : [0, 0];
  unit = WINDOW / box.size;
  origin = [x + (box.left + box.right) / 2, y + (box.low + box.high) / 2];
  const [right, high] = [unit * (box.right - box.left) / 2, unit * (box.high - box.low) / 2], view = { left: -right, right, low: -high, high };
  part("stage").setAttribute("viewBox", [view.left, -view.high, view.right - view.left, view.high - view.low].join(" "));
  part("stage").dataset.follow = follow;
  const metres = Math.pow(10, Math.floor(Math.log10(box.size / 2))), square = unit * metres;
  stage_view = view;
  part("square").textContent = length(metres);
  const lines = [];
  const line = (x1, y1, x2, y2) => lines.push("M" + x1 + " " + -y1 + "L" + x2 + " " + -y2);
  // Over the whole window, which is wider or higher than the view.
  const [half, tall] = [part("stage").clientWidth, part("stage").clientHeight].map((size) => Math.max(size * pixel() / 2, right));
  const shift = origin.map((at) => at / metres - Math.floor(at / metres));
  for (let i = Math.ceil(-half / square + shift[0]); i - shift[0] <= half / square; i++) line((i - shift[0]) * square, -tall, (i - shift[0]) * square, tall);
  for (let i = Math.ceil(-tall / square + shift[1]); i - shift[1] <= tall / square; i++) line(-half, (i - shift[1]) * square, half, (i - shift[1]) * square);
  const behind = { x: -half, y: -tall, width: 2 * half, height: 2 * tall };
  for (const name in behind) part("media").setAttribute(name, behind[name]);
  if (!part("grid").firstChild) part("grid").append(shape("path", { "vector-effect": "non-scaling-stroke" }));
  part("grid").firstChild.setAttribute("d", lines.join(""));
}
// The media behind the rod: one rectangle over the window, whose gradient blends where the interfaces do.
function within(k) {
  const media = motion.media, edges = media.moved ? media.moved[k] : media.edges, [x, y] = media.normal;
  const height = x * origin[0] + y * origin[1], blend = part("blend");
  const [low, high] = [edges[0][0] - height, edges[edges.length - 1][1] - height];
  for (const [name, value] of [["x1", x * low], ["y1", -y * low], ["x2", x * high], ["y2", -y * high]]) blend.setAttribute(name, unit * value);
  const stops = edges.flatMap((ends, j) => ends.map((end, side) => [(end - height - low) / (high - low), media.tints[j + side]]));
  blend.replaceChildren(...stops.map(([offset, tint]) => shape("stop", { offset, style: "stop-color: var(--medium-" + tint + ")" })));
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
  const beside = motion.beside.flatMap((other) => other.name ? entry(other.name, colour_of(other)) : []);
  if (motion.name) part("own").replaceChildren(...entry(motion.name, colour_of(motion)));
  const [force, flow] = [largest.force, largest.flow].map((size) => Number(size.toPrecision(3)));
  const drawn = [
    ...(force > 0 ? ["Arrow at the head: the force of the tail on it, at most " + force + "\u00a0N."] : []),
    ...(flow > 0 ? [" Grey arrows: the flow."] : []), ...(motion.tendons ? [" Lines along the rod: tendons."] : []),
  ];
  const name = part("colour").value, bar = document.createElement("span");
  bar.className = "scale"; bar.style.background = "linear-gradient(to right," + [-1, -0.5, 0, 0.5, 1].map(diverging).join(",") + ")";
  const most = name in FIELDS ? Number(size_of(name).toPrecision(3)) : 0;
  const scale = name in FIELDS ? [" " + part("colour").selectedOptions[0].textContent + ": −" + most, bar, most + "\u00a0" + FIELDS[name].unit + "."] : [];
  part("legend").replaceChildren(...drawn, ...scale, " ", ...layers, ...(beside.length ? [" Beside it:", ...beside] : []));
}
// The colour of a rod, as that of its series in charts; from so many series on, colours repeat with dashes.
const SERIES_COLOURS = {{ series_colours|length }};
function colour_of(rod) { return "var(--series-" + rod.series % SERIES_COLOURS + ")"; }
function show(k) {
  const frame = motion.points[k], com = motion.com[k];
  look(com);
  if (motion.media) within(k);
  part("rod").setAttribute("points", pairs(frame).trim());
  dress(k, frame); hold(k, frame); stream(k, stage_view);
  const paths = part("paths").checked ? [0, frame.length - 2] : [];
  part("ends").setAttribute("d", paths.map((i) => "M" + pairs(motion.points.slice(0, k + 1).flatMap((points) => [points[i], points[i + 1]]))).join(""));
  motion.beside.forEach((other, i) => {
    const [sides, body, line] = part("beside").children[i].children, points = other.points[k], outline = outline_of(points, other.half_widths);
    sides.setAttribute("points", outline); line.setAttribute("points", pairs(points)); line.setAttribute("stroke-width", outline ? 1.5 : 3);
    place_body(body, other.body, points);
  });
  part("trace").setAttribute("points", pairs(motion.com.slice(0, k + 1).flat()));
  part("head").style.display = motion.body || motion.head || motion.headless ? "none" : "";
  place_body(part("body"), motion.body, frame);
  part("head").setAttribute("cx", at_x(frame[0])); part("head").setAttribute("cy", at_y(frame[1]));
  part("com").setAttribute("cx", at_x(com[0])); part("com").setAttribute("cy", at_y(com[1]));
  part("time").value = k; part("clock").textContent = "t = " + motion.times[k].toFixed(clock_digits) + " s";
  part("stage").dataset.frame = k;
  document.dispatchEvent(new CustomEvent("shown", { detail: motion.times[k] }));
}
// On paper stands the last frame, with some shapes of the period before it or, without one, of the time before it.
let printing = false;
const EARLIER = 5;
addEventListener("beforeprint", () => {
  if (!motion) return;
  printing = true;
  const [first, end] = [motion.times[0], motion.times[motion.times.length - 1]], since = Math.max(first, end - (motion.period ?? Infinity));
  show(motion.times.length - 1);
  const frames = new Set(Array.from({ length: EARLIER }, (_, i) => at(since + (end - since) * i / EARLIER)));
  part("earlier").replaceChildren(...[motion, ...motion.beside].flatMap((rod) => [...frames].map((k) =>
    shape("polyline", { points: pairs(rod.points[k]).trim(), style: "stroke: " + colour_of(rod), "vector-effect": "non-scaling-stroke" }))));
});
addEventListener("afterprint", () => {
  if (!motion) return;
  printing = false;
  part("earlier").replaceChildren(); show(at(now));
});
// The frame nearest to a time.
function at(time) {
  let a = 0, b = motion.times.length - 1;
  while (a < b) { const m = (a + b) >> 1; if (motion.times[m] + motion.times[m + 1] >= 2 * time) b = m; else a = m + 1; }
  return a;
}
function tick(stamp) {
  if (playing && !printing && last !== null) {
    now += (stamp - last) / 1000 * Number(part("speed").value);
    if (now > motion.times[motion.times.length - 1]) now = motion.times[0];
    show(at(now));
  }
  last = stamp; requestAnimationFrame(tick);
}
// Shows a time and stays there.
function halt(time) { playing = false; part("play").textContent = "Play"; now = time; show(at(time)); address(); }
part("play").onclick = () => { playing = !playing; part("play").textContent = playing ? "Pause" : "Play"; if (!playing) address(); };
part("time").oninput = () => halt(motion.times[Number(part("time").value)]);
part("follow").onchange = part("paths").onchange = () => show(Number(part("time").value));
part("colour").onchange = () => { named(motion.media); show(Number(part("time").value)); address(); };
if ([...part("colour").options].some((option) => option.value === asked("colour"))) part("colour").value = asked("colour");
// The cursor of a chart: a click stays at its time, and a player that stands follows it.
document.addEventListener("seek", (event) => {
  const time = motion && within_run(event.detail.time);
  if (event.detail.pauses) halt(time); else if (motion && !playing) { now = time; show(at(time)); }
});
addEventListener("hashchange", () => {
  if (!motion) return;
  const wanted = [...part("colour").options].find((option) => option.value === (asked("colour") ?? "body") && !option.disabled);
  if (wanted) part("colour").value = wanted.value;
  named(motion.media);
  halt(within_run(asked("t")) ?? now);
});
const KEYS = {
  " ": () => part("play").click(), k: () => part("play").click(), f: () => part("follow").click(),
  ArrowLeft: () => step(-1), ArrowRight: () => step(1), Home: () => step(-Infinity), End: () => step(Infinity),
  "+": () => faster(1), "-": () => faster(-1),
};
function step(frames) { halt(motion.times[Math.min(Math.max(Number(part("time").value) + frames, 0), motion.times.length - 1)]); }
function faster(by) { const list = part("speed"); list.selectedIndex = Math.min(Math.max(list.selectedIndex + by, 0), list.options.length - 1); }
// Not where a key means something else, as in a field of a table.
addEventListener("keydown", (event) => {
  const elsewhere = event.target.closest?.("input:not([type=range], [type=checkbox]), select, textarea, [tabindex]") || event.key === " " && event.target.closest?.("button, [type=checkbox]");
  const run = !elsewhere && !event.ctrlKey && !event.metaKey && !event.altKey && motion ? KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key] : undefined;
  if (run) { event.preventDefault(); run(); }
});
function start() { requestAnimationFrame(tick); }
