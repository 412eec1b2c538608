// Puts the page together: follows the market, and draws what has changed, at most once a second where it costs.
import { follow, get } from "./api.js";
import { draw as drawCharts, drawBills } from "./charts.js";
import { drawControls, drawPicker, startControls } from "./controls.js";
import { clock, count } from "./format.js";
import { drawHomes, refreshSpawners, startAdding } from "./homes.js";
import { dayNow, load, past } from "./past.js";
import { drawAgents, startAsking } from "./policy.js";
import { start as startTheme } from "./theme.js";
import { drawBetter, drawPrice, drawReserve, drawSelling } from "./tiles.js";
import { charted, view } from "./view.js";

const $ = (id) => document.getElementById(id);
const REFRESH_MS = 1000;
const FAST = 2; // slots a second
const STATES = { waiting: "waiting for agents", running: "live", paused: "paused", ended: "over", away: "away" };
let shown = 50;
let charts = { busy: false, again: false, key: "" };

// ------------------------------------------------------------------ what comes from the gateway

let lastRefresh = 0;
let planned = null;

/** Soon, but not more often than the gateway itself knows anything new. */
function refreshSoon() {
  planned ??= setTimeout(async () => {
    lastRefresh = performance.now();
    await refresh().catch(() => {});
    planned = null;
  }, Math.max(0, lastRefresh + REFRESH_MS - performance.now()));
}

async function refresh() {
  const [status, homes] = await Promise.all([get("/v1/market"), get(`/v1/prosumers?limit=${shown}`)]);
  const came = homes.total !== view.total;
  Object.assign(view, { status, homes: homes.prosumers, total: homes.total });
  if (came) await refreshSpawners();
  if (!view.scenario || view.scenario.name !== status.scenario) view.scenario = await get("/v1/scenario").catch(() => null);
  drawStatus();
  drawBills();
  await refreshCharts();
}

function onSlot(slot) {
  const before = view.slot;
  if (before && slot.position < before.position) view.scenario = null; // the market began anew
  view.slot = slot;
  requestAnimationFrame(drawSlot);
  refreshSoon();
}

function onMarket(present) {
  view.present = present;
  if (!present) view.status = null;
  drawState();
  if (present) refreshSoon();
}

function onGateway(there) {
  view.gateway = there;
  if (!there) view.present = false;
  drawState();
}

// ------------------------------------------------------------------ drawing

function drawSlot() {
  const { slot, status } = view;
  // A fast market is drawn when its status comes: figures of one moment, together.
  if (!slot || (status?.slots_per_s ?? 0) > FAST) return;
  drawTime(slot);
  drawPrice(slot, past.follow && past.span === 1 ? past.rows : []);
}

function drawTime(slot) {
  $("time").textContent = clock(slot.hour);
  $("day").textContent = `day ${count(slot.day)}`;
  document.title = `${(100 * slot.buy_price).toFixed(1)} ¢ · zengrid`;
}

const most = () => view.scenario?.facilities?.slice(0, 2).reduce((sum, facility) => sum + Math.min(facility.max_kw, 30), 0);

function drawStatus() {
  const { status } = view;
  if (!status) return;
  const slot = status.last ?? view.slot;
  if (slot) {
    drawTime(slot);
    drawPrice(slot, past.follow && past.span === 1 ? past.rows : []);
    drawReserve(slot, slot.baseline_facility_kw, most());
    drawSelling(slot, view.homes, view.total);
  }
  drawBetter(status.totals, status.slots_per_day);
  $("scenario").textContent = view.scenario?.title || status.scenario;
  $("scenario").title = `run ${status.run}, scenario ${status.scenario}, seed ${status.seed}`;
  drawHomes(() => { drawHomes(() => {}); refreshCharts(true); drawStatus(); });
  drawAgents();
  drawState();
}

function drawState() {
  const away = !view.gateway || !view.present;
  const state = away ? "away" : view.status?.state ?? "waiting";
  document.body.dataset.market = state;
  $("state").dataset.state = state;
  const rate = view.status?.slots_per_s ?? 0;
  const text = state === "running" && rate >= 2 ? `live · ${count(rate)} slots/s` : STATES[state];
  if ($("state").textContent !== text) $("state").textContent = text;
  const notice = !view.gateway ? "The gateway does not answer. This page reconnects by itself."
    : !view.present ? "The market is away. This page goes on as soon as it is back."
    : state === "waiting" ? "The market waits for its agents." : state === "ended" ? "The market is over. Its history stays." : "";
  $("notice").hidden = !notice;
  $("notice").dataset.kind = away ? "away" : "info";
  $("notice").textContent = notice;
  drawControls();
}

/** Read and draw the charts anew, unless nothing can have changed. */
async function refreshCharts(force = false) {
  const homes = charted();
  const newest = past.follow || (view.slot && view.slot.day <= past.day) ? view.slot?.position : "";
  const key = [past.follow ? dayNow() : past.day, past.span, past.follow, newest, homes.join()].join("|");
  if (charts.busy) { charts.again = true; return; }
  if (key === charts.key && !force) return;
  charts.busy = true;
  try {
    await load(homes);
    drawPicker();
    $("h-charts").textContent = past.span === 1 ? `Day ${count(past.day)}` : `Days ${count(past.first)} to ${count(past.day)}`;
    $("chart-note").textContent = past.follow && view.slot && past.day < view.slot.day && view.status?.state === "running"
      ? "the last whole day: days pass too fast to watch" : past.rows.length ? "dotted: without demand response" : "nothing settled here yet";
    if (view.slot) drawPrice(view.status?.last ?? view.slot, past.follow && past.span === 1 ? past.rows : []);
    await drawCharts();
    charts.key = key;
  } catch (error) {
    if (view.present) $("chart-note").textContent = error.message;
  }
  charts.busy = false;
  if (charts.again) { charts.again = false; refreshCharts(); }
}

// ------------------------------------------------------------------ start

startTheme();
startControls(() => { drawPicker(); refreshCharts(true); }, (status) => { Object.assign(view, { status }); drawStatus(); refreshSoon(); },
  (problem) => { $("notice").hidden = false; $("notice").textContent = problem.message; });
startAdding();
startAsking();
$("more-button").onclick = () => { shown = Math.min(shown + 50, 1000); refreshSoon(); };
addEventListener("homes", async () => { await refreshSpawners(); refreshSoon(); });
addEventListener("theme", () => { if (view.slot) { drawStatus(); drawCharts(); } });
drawState();
setInterval(() => view.present && refreshSoon(), 5000); // agents come and go in a market that stands still, too
follow({ onSlot, onMarket, onGateway });
