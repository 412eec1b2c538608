// The gateway's public API, and nothing else: requests, problems, the live stream, the token.
const KEY = "zengrid-token";
const QUIET_MS = 40_000; // the gateway sends something every 15 s
let asking = null;

export class Problem extends Error {
  constructor(body, status) {
    super(body.detail || body.title || `HTTP ${status}`);
    this.kind = (body.type || "").replace("urn:zengrid:", "");
    this.status = status;
    this.errors = body.errors || [];
  }
}

const token = () => sessionStorage.getItem(KEY);
const headers = () => (token() ? { authorization: `Bearer ${token()}` } : {});

async function problemOf(response) {
  const body = await response.json().catch(() => ({}));
  return new Problem(body, response.status);
}

export async function get(path) {
  const response = await fetch(path, { headers: headers() });
  if (response.ok) return response.json();
  if (response.status === 401 && (await askToken())) return get(path);
  throw await problemOf(response);
}

export async function send(method, path, body, extra = {}) {
  const options = { method, headers: { ...headers(), ...extra } };
  if (body !== undefined) {
    options.headers["content-type"] = "application/json";
    options.body = JSON.stringify(body);
  }
  const response = await fetch(path, options);
  if (response.ok) return response.status === 204 ? null : response.json();
  const problem = await problemOf(response);
  if ((response.status === 401 || response.status === 403) && (await askToken(problem.message))) {
    return send(method, path, body, extra);
  }
  throw problem;
}

/** Ask for a token once, whoever needs it; false where none was given. */
function askToken(why) {
  asking ??= new Promise((resolve) => {
    const dialog = document.getElementById("token-dialog");
    const form = document.getElementById("token-form");
    if (why) document.getElementById("token-text").textContent = why;
    form.reset();
    form.onsubmit = () => { sessionStorage.setItem(KEY, form.elements.token.value.trim()); dialog.close("ok"); };
    document.getElementById("token-cancel").onclick = () => dialog.close("");
    dialog.onclose = () => { asking = null; resolve(dialog.returnValue === "ok"); };
    dialog.returnValue = "";
    dialog.showModal();
  });
  return asking;
}

/** Follow the market for ever: reconnects by itself, and goes on after the slot it has seen last. */
export async function follow({ onSlot, onMarket, onGateway }) {
  let last = null;
  for (let failures = 0; ; failures++) {
    const abort = new AbortController();
    let timer;
    const alive = () => { clearTimeout(timer); timer = setTimeout(() => abort.abort(), QUIET_MS); };
    try {
      alive();
      const extra = last === null ? {} : { "last-event-id": String(last) };
      const response = await fetch("/v1/live", { headers: { ...headers(), ...extra }, signal: abort.signal });
      if (response.status === 401) await askToken();
      if (!response.ok) throw await problemOf(response);
      onGateway(true);
      failures = 0;
      for await (const event of events(response.body, alive)) {
        if (event.name === "slot") { last = event.data.position; onSlot(event.data); }
        if (event.name === "market") onMarket(event.data.present);
      }
    } catch { /* gone; tell, and try again */ }
    clearTimeout(timer);
    onGateway(false);
    await new Promise((resolve) => setTimeout(resolve, Math.min(500 * 1.5 ** failures, 5000)));
  }
}

async function* events(body, alive) {
  const reader = body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    alive();
    text += value;
    let end;
    while ((end = text.indexOf("\n\n")) >= 0) {
      const fields = Object.fromEntries(text.slice(0, end).split("\n").map((line) => line.split(/: (.*)/s).slice(0, 2)));
      text = text.slice(end + 2);
      if (fields.event) yield { name: fields.event, data: JSON.parse(fields.data) };
    }
  }
}
