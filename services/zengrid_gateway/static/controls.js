// Pause, step, speed; which days are shown; the keyboard.
import { send } from "./api.js";
import { past } from "./past.js";
import { view } from "./view.js";

const $ = (id) => document.getElementById(id);

export function startControls(onDays, onStatus, onProblem) {
  const steer = async (command) => {
    try { onStatus(await send("POST", "/v1/control", command)); } catch (problem) { onProblem(problem); }
  };
  $("pause").onclick = () => steer({ command: paused() ? "resume" : "pause" });
  $("step").onclick = () => steer({ command: "step", slots: 1 });
  $("speed").onchange = () => steer({ command: "speed", speed: Number($("speed").value) });
  const move = (days) => { past.follow = false; past.day = Math.max(past.day + days, 0); onDays(); };
  $("earlier").onclick = () => move(-past.span);
  $("later").onclick = () => move(past.span);
  $("pick").onchange = () => { past.follow = false; past.day = Math.max(Math.floor(Number($("pick").value)) || 0, 0); onDays(); };
  $("follow").onclick = () => { past.follow = true; onDays(); };
  $("span").onchange = () => { past.span = Number($("span").value); onDays(); };
  addEventListener("keydown", (event) => {
    if (event.target.closest("input, select, button, a, dialog, [role=region]") || event.ctrlKey || event.metaKey || event.altKey) return;
    const key = { " ": "pause", ".": "step", ArrowLeft: "earlier", ArrowRight: "later" }[event.key];
    if (key) { event.preventDefault(); $(key).click(); }
  });
}

const paused = () => view.status?.state === "paused";

export function drawControls() {
  const status = view.status, there = view.gateway && view.present && status && status.state !== "ended";
  for (const id of ["pause", "step", "speed", "add"]) $(id).disabled = !there;
  $("pause").textContent = paused() ? "Go on" : "Pause";
  $("pause").setAttribute("aria-pressed", Boolean(paused()));
  if (status && document.activeElement !== $("speed")) {
    const value = String(status.speed);
    if (![...$("speed").options].some((option) => option.value === value)) $("speed").append(new Option(`${status.speed} ×`, value));
    $("speed").value = value;
  }
}

export function drawPicker() {
  if (document.activeElement !== $("pick")) $("pick").value = past.day;
  $("follow").setAttribute("aria-pressed", past.follow);
  $("earlier").disabled = past.day <= 0;
}
