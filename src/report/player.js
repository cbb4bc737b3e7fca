// Plays a motion: { times, points: flat x, y of the nodes at each time, com, beside: points of another rod, if any }. Call start
// once, play for every motion.
let motion = null, playing = true, now = 0, last = null;
const part = (id) => document.getElementById(id);
const pairs = (flat) => { let text = ""; for (let i = 0; i < flat.length; i += 2) text += flat[i] + "," + -flat[i + 1] + " "; return text; };
function play(wanted) {
  motion = wanted;
  // The window that holds every frame, y upwards.
  let [left, right, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
  for (const frame of motion.points.concat(motion.beside ?? [])) for (let k = 0; k < frame.length; k += 2) {
    left = Math.min(left, frame[k]); right = Math.max(right, frame[k]);
    low = Math.min(low, frame[k + 1]); high = Math.max(high, frame[k + 1]);
  }
  const size = Math.max(right - left, high - low, 1e-9), edge = 0.06 * size;
  left -= edge; right += edge; low -= edge; high += edge;
  if (high - low < 0.3 * size) { const middle = (high + low) / 2; low = middle - 0.15 * size; high = middle + 0.15 * size; }
  part("stage").setAttribute("viewBox", [left, -high, right - left, high - low].join(" "));
  const square = Math.pow(10, Math.floor(Math.log10(size / 2)));
  part("square").textContent = String(Number(square.toPrecision(1)));
  part("grid").replaceChildren();
  const line = (x1, y1, x2, y2) => {
    const node = document.createElementNS("http://www.w3.org/2000/svg", "line");
    for (const [name, value] of Object.entries({ x1, y1, x2, y2, "vector-effect": "non-scaling-stroke" })) node.setAttribute(name, value);
    part("grid").append(node);
  };
  for (let x = Math.ceil(left / square) * square; x <= right; x += square) line(x, -low, x, -high);
  for (let y = Math.ceil(low / square) * square; y <= high; y += square) line(left, -y, right, -y);
  part("head").setAttribute("r", 0.011 * size); part("com").setAttribute("r", 0.008 * size);
  part("time").max = motion.times.length - 1;
  part("stage").dataset.frames = motion.times.length;
  now = motion.times[0]; playing = motion.times.length > 1; part("play").textContent = playing ? "Pause" : "Play";
  show(0);
}
function show(k) {
  const frame = motion.points[k], com = motion.com[k];
  part("rod").setAttribute("points", pairs(frame));
  part("beside").setAttribute("points", motion.beside ? pairs(motion.beside[k]) : "");
  part("trace").setAttribute("points", pairs(motion.com.slice(0, k + 1).flat()));
  part("head").setAttribute("cx", frame[0]); part("head").setAttribute("cy", -frame[1]);
  part("com").setAttribute("cx", com[0]); part("com").setAttribute("cy", -com[1]);
  part("time").value = k; part("clock").textContent = "t = " + motion.times[k].toFixed(3) + " s";
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
function start() { requestAnimationFrame(tick); }
