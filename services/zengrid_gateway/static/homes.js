// The table of agents: presence, batteries, bills, fallbacks; and homes that come and go.
import { Problem, get, send } from "./api.js";
import { change, count, money, percent, signedKw, tidy } from "./format.js";
import { homeColour } from "./theme.js";
import { charted, place, toggleHome, view } from "./view.js";

const $ = (id) => document.getElementById(id);
const LABELS = ["", "Plays", "Battery", "Charging", "At the meter", "Bill", "Saved", "Missed slots", ""];
const PRESENCE = { present: "there", absent: "too slow", away: "away" };
const CAUSES = { deadline: "too late", gone: "died", absent: "too slow", away: "away" };
let known = null;

const element = (tag, properties = {}, ...children) => {
  const node = Object.assign(document.createElement(tag), properties);
  node.append(...children.filter((child) => child !== null));
  return node;
};

export function drawHomes(onToggle) {
  const body = document.querySelector("#homes tbody");
  const agents = view.status?.agents ?? [];
  const grid = agents.find((agent) => agent.role === "grid");
  const rows = [...(grid ? [gridRow(grid)] : []), ...view.homes.map((home) => homeRow(home, onToggle))];
  const ids = new Set(view.homes.map((home) => home.id));
  const focus = document.activeElement?.dataset?.focus;
  body.replaceChildren(...rows);
  if (focus) body.querySelector(`[data-focus="${CSS.escape(focus)}"]`)?.focus();
  if (known) for (const home of view.homes) if (!known.has(home.id)) body.querySelector(`tr[data-id="${home.id}"]`)?.classList.add("new");
  known = ids;
  const missing = agents.filter((agent) => agent.presence !== "present");
  $("homes-note").textContent = missing.length
    ? `${missing.slice(0, 4).map((agent) => `${agent.id} is ${PRESENCE[agent.presence]}`).join(", ")}${missing.length > 4 ? ", …" : ""}: the conventional rule stands in`
    : agents.length ? "All agents answer in time" : "";
  $("more").hidden = view.homes.length >= view.total;
}

function row(id, cells) {
  return element("tr", {}, ...cells.map((cell, i) => {
    const node = i === 0 ? element("td") : element("td", { className: [3, 4, 5, 6, 7].includes(i) ? "r" : "" });
    node.dataset.label = LABELS[i];
    if (cell !== null) node.append(cell);
    return node;
  }));
}

const badge = (presence) => {
  const node = element("span", { className: "presence", textContent: PRESENCE[presence] });
  node.dataset.p = presence;
  return node;
};

const missed = (fallbacks, cause) =>
  element("span", {}, count(fallbacks), fallbacks && cause ? element("small", { textContent: ` ${CAUSES[cause] ?? cause}` }) : null);

function gridRow(grid) {
  const totals = view.status.totals;
  const delta = change(totals.profit, totals.baseline_profit);
  const saved = element("span", { textContent: delta ? delta.text : "–" });
  if (delta && Math.abs(delta.fraction) > 0.0005) saved.dataset.good = delta.fraction > 0;
  const bill = element("span", {}, money(totals.profit), element("small", { textContent: " profit" }));
  return row("grid", [
    element("span", {}, element("b", { textContent: "grid" }), badge(grid.presence)), grid.policy || "–", null, null, null, bill, saved,
    missed(grid.fallbacks, grid.last_cause), null,
  ]);
}

function homeRow(home, onToggle) {
  const swatch = element("span", { className: "swatch" });
  const shown = charted().includes(home.id);
  swatch.style.background = shown ? homeColour(place(home.id)) : "transparent";
  swatch.style.outline = shown ? "" : "1px solid var(--line)";
  const name = element("button", { type: "button", className: "name", title: "Show or hide in the charts" }, swatch, home.id);
  name.setAttribute("aria-pressed", shown);
  name.dataset.focus = `name-${home.id}`;
  name.onclick = () => { toggleHome(home.id); onToggle(); };
  const bar = element("i");
  bar.style.setProperty("--w", `${100 * home.soc}%`);
  const battery = home.capacity_kwh
    ? element("span", { className: "soc" }, bar, element("span", { className: "num", textContent: percent(home.soc) }), element("small", { textContent: `of ${home.capacity_kwh} kWh` }))
    : element("small", { textContent: "none" });
  const meter = element("span", { textContent: signedKw(home.injection_kw) });
  if (tidy(home.injection_kw) > 0) meter.dataset.good = true;
  const saving = home.baseline_bill - home.bill;
  const saved = element("span", { textContent: money(saving) });
  if (Math.abs(saving) >= 0.005) saved.dataset.good = saving > 0;
  const line = row(home.id, [
    element("span", {}, name, badge(home.presence), home.agent === home.id ? null : element("small", { textContent: ` ${home.agent}` })),
    home.policy || "–", battery, home.capacity_kwh ? signedKw(home.battery_kw) : "–", meter, money(home.bill), saved,
    missed(home.fallbacks, home.last_cause), removeButton(home.id),
  ]);
  line.dataset.id = home.id;
  return line;
}

function removeButton(id) {
  if (!view.spawners.some((spawner) => spawner.processes.some((process) => process.id === id))) return null;
  const button = element("button", { type: "button", className: "remove", textContent: "Remove" });
  button.setAttribute("aria-label", `Remove ${id}`);
  button.dataset.focus = `remove-${id}`;
  button.onclick = async () => {
    button.disabled = true;
    try { await send("DELETE", `/v1/prosumers/${id}`); } catch (problem) { $("homes-note").textContent = problem.message; }
    dispatchEvent(new Event("homes"));
  };
  return button;
}

// ------------------------------------------------------------------ adding a home

export function startAdding() {
  const dialog = $("add-dialog"), form = $("add-form"), field = form.elements;
  $("add").onclick = async () => {
    form.reset();
    $("add-error").hidden = true;
    field.id.value = freeName();
    dialog.showModal();
    await refreshSpawners();
    const policies = [...new Set(view.spawners.flatMap((spawner) => spawner.policies))];
    field.policy.replaceChildren(...(policies.length ? policies : ["trained"]).map((name) => new Option(name)));
    if (!view.spawners.length) complain(new Error("No spawner is running: start one with “zengrid spawner”, or add the home with “zengrid prosumer”."));
  };
  $("add-cancel").onclick = () => dialog.close();
  form.onsubmit = async (event) => {
    event.preventDefault();
    $("add-ok").disabled = true;
    $("add-error").hidden = true;
    const number = (name) => Number(field[name].value);
    const battery = { capacity_kwh: number("capacity_kwh"), charge_max_kw: number("power_kw"), discharge_max_kw: number("power_kw") };
    const home = { id: field.id.value.trim(), pv_kw: number("pv_kw"), battery, load: { scale: number("scale") }, policy: field.policy.value };
    try {
      await send("POST", "/v1/prosumers", home, { "idempotency-key": crypto.randomUUID?.() ?? String(Math.random()) });
      dialog.close();
      dispatchEvent(new Event("homes"));
    } catch (problem) { complain(problem); }
    $("add-ok").disabled = false;
  };
}

function complain(problem) {
  const fields = problem instanceof Problem && problem.errors.length
    ? problem.errors.map((error) => `${error.field.replace("body.", "")}: ${error.allowed}`).join("; ") : problem.message;
  $("add-error").textContent = fields;
  $("add-error").hidden = false;
}

function freeName() {
  const taken = new Set(view.homes.map((home) => home.id));
  let n = view.total + 1;
  while (taken.has(`p${n}`)) n++;
  return `p${n}`;
}

export async function refreshSpawners() {
  try { view.spawners = (await get("/v1/spawners")).spawners; } catch { view.spawners = []; }
}
