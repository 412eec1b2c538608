// "What would you do?": a policy's answers over two quantities, as a heat map.
import { get, send } from "./api.js";
import { config, layout, plotly } from "./charts.js";
import { cents, clock, kw, percent, signedKw } from "./format.js";
import { colour } from "./theme.js";
import { view } from "./view.js";

const $ = (id) => document.getElementById(id);
const FINE = 33;
const PRICE = { low: 0.03, high: 0.12, step: 0.005, show: (value) => `${cents(value)} ¢` };
const QUANTITIES = {
  soc: { name: "stored energy", low: 0, high: 1, step: 0.01, show: percent },
  buy_price: { ...PRICE, name: "price the grid pays" },
  sell_price: { ...PRICE, name: "price the grid asks" },
  pv_kw: { name: "solar power", low: 0, high: 8, step: 0.1, show: kw },
  load_kw: { name: "consumption", low: 0, high: 8, step: 0.1, show: kw },
  hour: { name: "time of day", low: 0, high: 23.75, step: 0.25, show: clock },
  demand_kw: { name: "demand", low: 0, high: 60, step: 0.5, show: kw },
  payments: { name: "paid to the homes", low: 0, high: 2, step: 0.01, show: (value) => `$${value.toFixed(2)}` },
};
const known = (name) => QUANTITIES[name] ?? { name: name.replaceAll("_", " "), low: 0, high: 10, step: 0.1, show: (value) => value.toFixed(2) };
let details = null;
let values = {};
let asking = 0;
let timer;

export function startAsking() {
  $("ask-agent").onchange = choose;
  for (const id of ["ask-x", "ask-y"]) $(id).onchange = () => { sliders(); ask(); };
  $("ask-now").onclick = choose;
  $("ask").onsubmit = (event) => event.preventDefault();
  addEventListener("theme", () => details && ask());
}

/** Offer the agents of the market; asks the first one once they are known. */
export function drawAgents() {
  const agents = (view.status?.agents ?? []).map((agent) => agent.id).sort((a, b) => (a === "grid") - (b === "grid"));
  const select = $("ask-agent");
  if (agents.join() === [...select.options].map((option) => option.value).join()) return;
  const before = select.value;
  select.replaceChildren(...agents.map((id) => new Option(id)));
  const there = view.status.agents.filter((agent) => agent.presence !== "away").map((agent) => agent.id);
  select.value = agents.includes(before) ? before : agents.find((id) => there.includes(id)) ?? agents[0];
  if (agents.length && select.value !== before) choose();
}

async function choose() {
  const agent = $("ask-agent").value;
  if (!agent) return;
  try {
    details = await get(`/v1/policies/${agent}`);
  } catch (problem) { return tell(problem.message); }
  values = { ...details.now };
  const names = Object.keys(details.now).filter((name) => name !== "homes");
  const [x, y] = details.role === "grid" ? ["hour", "demand_kw"] : ["soc", "pv_kw"];
  for (const [id, wanted] of [["ask-x", x], ["ask-y", y]]) {
    $(id).replaceChildren(...names.map((name) => new Option(known(name).name, name)));
    $(id).value = names.includes(wanted) ? wanted : names[0];
  }
  sliders();
  await ask();
}

function sliders() {
  const shown = Object.keys(details.now).filter((name) => ![$("ask-x").value, $("ask-y").value].includes(name) && name in QUANTITIES);
  $("ask-rest").replaceChildren(...shown.map((name) => {
    const { name: label, low, high, step, show } = known(name);
    const line = document.createElement("label");
    line.className = "slider";
    const input = Object.assign(document.createElement("input"), { type: "range", min: low, max: Math.max(high, values[name]), step, value: values[name] });
    const output = Object.assign(document.createElement("output"), { textContent: show(values[name]) });
    input.oninput = () => { values[name] = Number(input.value); output.textContent = show(values[name]); clearTimeout(timer); timer = setTimeout(ask, 120); };
    line.append(label, output, input);
    return line;
  }));
}

const range = (name) => {
  const { low, high } = known(name);
  const top = Math.max(high, details.now[name] ?? 0);
  return Array.from({ length: FINE }, (_, i) => low + (top - low) * i / (FINE - 1));
};

async function ask() {
  const number = ++asking, agent = details.agent;
  const [xName, yName] = [$("ask-x").value, $("ask-y").value];
  if (xName === yName) return tell("Choose two different quantities.");
  const xs = range(xName), ys = range(yName);
  const quantities = { ...Object.fromEntries(Object.entries(values).filter(([name]) => name in QUANTITIES)),
    [xName]: ys.flatMap(() => xs), [yName]: ys.flatMap((value) => xs.map(() => value)) };
  let answer;
  try {
    answer = await send("POST", `/v1/policies/${agent}/query`, { quantities });
  } catch (problem) { return tell(problem.message); }
  if (number !== asking) return;
  const grid = details.role === "grid", scale = grid ? 100 : 1;
  const z = ys.map((_, i) => answer.actions.slice(i * FINE, (i + 1) * FINE).map((action) => scale * action));
  draw(await plotly(), { xs, ys, z, xName, yName, grid });
  tell("");
  $("ask-caption").replaceChildren(`${agent} plays ${answer.policy}: `, Object.assign(document.createElement("b"), {
    textContent: grid ? `it would pay ${cents(details.action)} ¢ now` : doing(details.action) }));
}

const doing = (power) => (Math.abs(power) < 0.005 ? "it would leave its battery alone now"
  : `it would ${power > 0 ? "charge" : "discharge"} with ${kw(Math.abs(power))} now`);

function draw(Plotly, { xs, ys, z, xName, yName, grid }) {
  const most = Math.max(0.1, ...z.flat().map(Math.abs));
  const diverging = [[0, colour("sell")], [0.5, colour("card")], [1, colour("buy")]];
  const prices = [[0, colour("soft")], [1, colour("buy")]];
  const ticks = (name) => {
    const values = range(name), chosen = [0, 8, 16, 24, 32].map((i) => values[i]);
    return { tickvals: chosen, ticktext: chosen.map(known(name).show), title: { text: known(name).name, standoff: 6 }, rangemode: "normal", showgrid: false, zeroline: false };
  };
  const text = z.map((line, i) => line.map((value, j) =>
    `${known(xName).name} ${known(xName).show(xs[j])}<br>${known(yName).name} ${known(yName).show(ys[i])}<br><b>${grid ? `${value.toFixed(1)} ¢` : signedKw(value)}</b>`));
  Plotly.react("c-policy", [
    { type: "heatmap", x: xs, y: ys, z, text, hoverinfo: "text", colorscale: grid ? prices : diverging, ...(grid ? {} : { zmin: -most, zmax: most }),
      colorbar: { title: { text: grid ? "¢/kWh" : "kW", side: "right" }, thickness: 12, outlinewidth: 0, tickfont: { color: colour("muted") } } },
    { type: "scatter", mode: "markers", x: [details.now[xName]], y: [details.now[yName]], hoverinfo: "skip", showlegend: false,
      marker: { size: 13, symbol: "circle-open", color: colour("text"), line: { width: 2.5 } } },
  ], layout({ xaxis: ticks(xName), yaxis: ticks(yName), hovermode: "closest", margin: { l: 60, r: 8, t: 10, b: 40 } }), config);
}

function tell(problem) {
  const sign = details?.role === "grid" ? "" : " Positive charges, negative discharges.";
  $("ask-note").textContent = problem || `The circle is where it stands now.${sign}`;
  $("c-policy").hidden = Boolean(problem);
}
