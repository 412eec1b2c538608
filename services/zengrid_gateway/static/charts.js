// The four charts of the day, drawn by Plotly.
import { past } from "./past.js";
import { charted, place, view } from "./view.js";
import { colour, homeColour } from "./theme.js";

let loading = null;

/** Plotly is large: it is fetched once the first glance is on screen. */
export function plotly() {
  loading ??= new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = "/plotly.min.js";
    script.onload = () => resolve(window.Plotly);
    script.onerror = () => { loading = null; reject(new Error("plotly cannot be loaded")); };
    document.head.append(script);
  });
  return loading;
}

export const config = { displayModeBar: false, responsive: true };

/** What all charts look alike in. */
export function layout(extra) {
  const axis = { gridcolor: colour("line"), zerolinecolor: colour("line"), linecolor: colour("line"), automargin: true, fixedrange: true };
  const { xaxis = {}, yaxis = {}, ...rest } = extra;
  return {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { family: "inherit", size: 12, color: colour("muted") },
    margin: { l: 34, r: 8, t: 26, b: 24 },
    legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom", traceorder: "normal", font: { size: 12, color: colour("text") } },
    hovermode: "x unified",
    hoverlabel: { bgcolor: colour("card"), bordercolor: colour("line"), font: { color: colour("text") } },
    xaxis: { ...axis, ...xaxis }, yaxis: { ...axis, rangemode: "tozero", ...yaxis }, ...rest,
  };
}

const x = (row) => (past.span === 1 ? row.hour : row.day + row.hour / 24);
const step = () => (past.span === 1 ? past.dt : past.dt / 24);

function timeAxis() {
  if (past.span === 1) {
    const hours = innerWidth < 560 ? [0, 6, 12, 18, 24] : [0, 4, 8, 12, 16, 20, 24];
    return { range: [0, 24], tickvals: hours, ticktext: hours.map((hour) => `${String(hour).padStart(2, "0")}:00`), showgrid: false };
  }
  return { range: [past.first, past.day + 1], tickformat: "d", nticks: 8, title: { text: "day", standoff: 4 }, showgrid: false };
}

/** A line that holds its value over each slot, to the end of the last one. */
function steps(rows, value, name, hue, extra = {}) {
  const xs = rows.map(x), ys = rows.map(value);
  if (rows.length) { xs.push(xs.at(-1) + step()); ys.push(ys.at(-1)); }
  return { x: xs, y: ys, name, type: "scatter", mode: "lines", line: { shape: "hv", width: 2, color: hue }, hovertemplate: "%{y:.1f}", ...extra };
}

export async function draw() {
  const Plotly = await plotly();
  const time = timeAxis(), rows = past.rows;
  const react = (id, data, extra) => Plotly.react(id, data, layout(extra), config);
  react("c-prices", [
    steps(rows, (row) => 100 * row.sell_price, "sells at", colour("sell")),
    steps(rows, (row) => 100 * row.buy_price, "buys at", colour("buy"), { line: { shape: "hv", width: 3, color: colour("buy") } }),
  ], { xaxis: time });
  const area = (hue) => ({ stackgroup: "supply", fillcolor: hue, line: { shape: "hv", width: 0, color: hue } });
  react("c-power", [
    steps(rows, (row) => row.base_kw, "base", colour("base"), area(colour("base"))),
    steps(rows, (row) => row.reserve_kw, "reserve", colour("reserve"), area(colour("reserve"))),
    steps(rows, (row) => row.demand_kw, "demand", colour("text"), { line: { shape: "hv", width: 1.6, color: colour("text") } }),
    steps(rows, (row) => row.export_kw, "export", colour("export")),
    steps(rows, (row) => row.baseline_base_kw + row.baseline_reserve_kw, "without", colour("muted"),
      { line: { shape: "hv", width: 1.6, dash: "dot", color: colour("muted") } }),
  ], { xaxis: time });
  react("c-soc", charted().flatMap(soc), { xaxis: time, yaxis: { range: [0, 100] } });
  drawBills(Plotly);
}

function soc(id) {
  const rows = past.homes.get(id) ?? [], hue = homeColour(place(id));
  const line = (value, name, extra) => ({
    x: rows.map((row) => x(row) + step()), y: rows.map((row) => 100 * row[value]), name, legendgroup: id,
    type: "scatter", mode: "lines", hovertemplate: "%{y:.0f} %", ...extra,
  });
  return [
    line("soc", id, { line: { width: 2.2, color: hue } }),
    line("baseline_soc", `${id} without`, { line: { width: 1.4, dash: "dot", color: hue }, showlegend: false, hoverinfo: "skip", hovertemplate: undefined, opacity: 0.75 }),
  ];
}

export function drawBills(Plotly = window.Plotly) {
  if (!Plotly) return;
  const shown = charted(), homes = view.homes.filter((home) => shown.includes(home.id)).reverse();
  const bar = (value, name, extra) => ({
    type: "bar", orientation: "h", y: homes.map((home) => home.id), x: homes.map((home) => home[value]), name,
    hovertemplate: "$%{x:.2f}", ...extra,
  });
  Plotly.react("c-bills", [
    bar("baseline_bill", "without demand response", { marker: { color: colour("base"), opacity: 0.55 } }),
    bar("bill", "now", { marker: { color: homes.map((home) => homeColour(place(home.id))) } }),
  ], layout({ barmode: "group", bargap: 0.28, hovermode: "y unified", legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom", traceorder: "reversed", font: { size: 12, color: colour("text") } }, xaxis: { tickprefix: "$", zerolinewidth: 2 }, yaxis: { rangemode: "normal", showgrid: false } }), config);
}
