// Draws the charts of a page, one in each element of the class "plot". Those over time share their cursor with each other and with the
// player, by two events of the document: "shown", of the player, and "seek", of a chart, whose details are times.
(() => {
"use strict";
const packed = ({ first, rest }) => Array.from(new Float32Array(Uint8Array.from(atob(rest), (c) => c.charCodeAt(0)).buffer), (x) => first + x);
const SERIES = [{% for pair in series_colours %}["{{ pair[0] }}", "{{ pair[1] }}"], {% endfor %}];
const INK = ["#505a64", "#aab4be"], GRID = ["#e2e7ec", "#333c46"], PAPER = ["#ffffff", "#161b21"];
const OVER_TIME = "time (s)", HEIGHT = 290, SIZE_IN_PRINT = [480, 215], SHARPNESS_IN_PRINT = 3;
const dark = matchMedia("(prefers-color-scheme: dark)");
const digits = (x, count) => {
  if (x === null || x === undefined) return "–";
  const size = Math.abs(x);
  if (x === 0) return "0";
  return size < 1e-3 || size >= 1e6 ? x.toExponential(count - 1).replace("e+", "e") : String(Number(x.toPrecision(count)));
};
// A number as pages write it, with a power of ten where it is small or large.
const raised = (power) => [...String(power)].map((c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]).join("");
const written = (x, count) => {
  const [, mantissa, power] = /^(.*)e(.*)$/.exec(digits(x, count)) ?? [];
  if (power === undefined) return digits(x, count).replace("-", "−");
  const part = String(Number(mantissa)).replace("-", "−");
  return (part === "1" ? "" : part === "−1" ? "−" : part + "·") + "10" + raised(power);
};
// Labels of an axis with the digits that tell them apart.
const labels = (plot, splits) => {
  const values = splits.filter((value) => value !== null), step = Math.abs(values[1] - values[0]) || 1;
  const tells = (count) => values.every((value) => Math.abs(Number(value.toPrecision(count)) - value) < 1e-3 * step);
  const count = [1, 2, 3, 4, 5, 6, 7, 8, 9].find(tells) ?? 9;
  return splits.map((value) => value === null ? "" : written(Number(value.toPrecision(12)), count));
};
// Powers of ten within an axis, a few of them, with zero between those of both signs.
const decades = (floor) => (plot, axis, min, max) => {
  const [low, high] = [floor ?? Math.max(min, Number.MIN_VALUE), Math.max(Math.abs(min), Math.abs(max))].map((x) => Math.log10(x));
  const [from, until] = [Math.ceil(low - 1e-9), Math.floor(high + 1e-9)], stride = Math.max(1, Math.ceil((until - from) / (floor ? 3 : 6)));
  const powers = [];
  for (let power = until; power >= from; power -= stride) powers.unshift(Number("1e" + power));
  // Too few to read: the numbers between.
  const near = powers.length > 1 || floor ? powers : [from - 1, from].flatMap((power) => [1, 2, 5].map((x) => Number(x + "e" + power)));
  const both = floor ? [...near.map((x) => -x).reverse(), 0, ...near] : near;
  return both.filter((x) => x >= min && x <= max);
};
const room = (plot, values) => 26 + 6.6 * Math.max(0, ...(values ?? []).map((value) => String(value).length));
// One x for all series, each with a value or none there.
function aligned(chart) {
  const shown = (y) => Number.isFinite(y) && (chart.y_scale !== "log" || y > 0) ? (chart.y_scale === "log" && chart.floor ? Math.max(y, chart.floor) : y) : null;
  const tables = chart.series.map((series, i) => [coordinates[chart.x_of[i]], packed(series.y).map(shown)]);
  const same = tables.every(([x]) => x === tables[0][0]);
  return { data: same ? [tables[0][0], ...tables.map(([, y]) => y)] : uPlot.join(tables), gaps: same };
}
function draw(place, chart, prints) {
  const theme = dark.matches && !prints ? 1 : 0, { data, gaps } = chart.aligned ??= aligned(chart);
  const axis = { stroke: INK[theme], grid: { stroke: GRID[theme], width: 1 }, ticks: { stroke: GRID[theme], width: 1 }, font: "12px system-ui, sans-serif", labelFont: "13px system-ui, sans-serif" };
  const [width, height] = prints ? SIZE_IN_PRINT : [Math.max(place.clientWidth, 200), HEIGHT];
  // As long as the plot is high; uPlot takes whole sizes only.
  const upright = Math.floor(Math.max(9, Math.min(13, (height - 70) / (0.54 * chart.y.length))));
  const close = (_, least, largest) => [least, largest === least ? 10 * least : largest];
  const scale = (kind) => ({ linear: { distr: 1 }, log: { distr: 3, range: close }, signed: { distr: 4, asinh: chart.floor ?? 1 } })[kind];
  const ticks = (kind, floor) => kind === "linear" ? { values: labels } : { splits: decades(floor), filter: (_, splits) => splits, values: (_, splits) => splits.map((x) => written(x, 2)) };
  const time = chart.x === OVER_TIME, single = chart.series.length === 1 && chart.series[0].label === "";
  const plot = new uPlot({
    width, height, title: chart.title, ...(prints ? { pxRatio: SHARPNESS_IN_PRINT } : {}),
    cursor: { drag: { x: true, y: true, uni: 30 }, ...(time ? { sync: { key: "time " + chart.x_of[0], scales: ["x", null] } } : {}), points: { size: 7 } },
    scales: { x: { time: false, ...scale(chart.x_scale) }, y: scale(chart.y_scale) },
    axes: [
      { ...axis, label: chart.x, labelSize: 20, size: 38, ...ticks(chart.x_scale, null) },
      { ...axis, label: chart.y, labelSize: 20, labelFont: upright + "px system-ui, sans-serif", size: room, ...ticks(chart.y_scale, chart.y_scale === "signed" ? chart.floor ?? 1 : null) },
    ],
    series: [{ label: chart.x, value: (_, x) => digits(x, 6) }, ...chart.series.map((series) => {
      const colour = SERIES[series.colour][theme];
      return { label: single ? chart.y : series.label, stroke: colour, width: series.line ? 2 : 0, spanGaps: !gaps, value: (_, y) => digits(y, 5),
        dash: series.dash ? series.dash.split(" ").map(Number) : undefined,
        points: { show: series.dots, size: 7, fill: colour, stroke: colour } };
    })],
    legend: { markers: { dash: (_, i) => i > 0 && chart.series[i - 1].dash ? "dashed" : "solid" } },
    hooks: { draw: [(plot) => mark(plot, chart)] },
  }, data, place);
  if (time) {
    const line = document.createElement("div"); line.className = "shown"; plot.over.append(line); chart.line = line;
    const seek = (event, pauses) => {
      const at = plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, "x");
      document.dispatchEvent(new CustomEvent("seek", { detail: { time: at, pauses } }));
    };
    plot.over.addEventListener("mousemove", (event) => { if (event.buttons === 0) seek(event, false); });
    plot.over.addEventListener("click", (event) => { if (plot.select.width < 2) seek(event, true); });
  }
  mark(plot, chart);
  return plot;
}
// Where the player is.
let shown = typeof motion === "object" && motion ? motion.times[at(now)] : null;
function mark(plot, chart) {
  if (!chart.line) return;
  const { min, max } = plot.scales.x, there = shown !== null && shown >= min && shown <= max;
  chart.line.style.display = there ? "" : "none";
  if (there) chart.line.style.left = plot.valToPos(shown, "x") + "px";
}
const { charts, x } = JSON.parse(document.getElementById("charts").textContent), coordinates = x.map(packed), places = [...document.querySelectorAll(".plot")];
let plots = [];
function drawAll(prints) {
  const hidden = plots.map((plot) => plot.series.map((series) => series.show));
  plots.forEach((plot) => plot.destroy());
  plots = charts.map((chart, i) => draw(places[i], chart, prints));
  plots.forEach((plot, i) => plot.series.forEach((series, k) => { if (hidden[i] && hidden[i][k] !== series.show) plot.setSeries(k, { show: hidden[i][k] }); }));
}
drawAll(false);
document.addEventListener("shown", (event) => { shown = event.detail; plots.forEach((plot, i) => mark(plot, charts[i])); });
dark.addEventListener("change", () => drawAll(false));
addEventListener("beforeprint", () => drawAll(true));
addEventListener("afterprint", () => drawAll(false));
new ResizeObserver(() => plots.forEach((plot, i) => {
  const width = Math.max(places[i].clientWidth, 200);
  if (width !== plot.width) plot.setSize({ width, height: HEIGHT });
})).observe(document.body);
document.body.dataset.charts = plots.length;
})();
