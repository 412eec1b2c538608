// The days on display: which they are, and what was settled in them.
import { get } from "./api.js";
import { view } from "./view.js";

const SHORT_DAY_S = 4; // a day that passes faster than this is shown when it is over

/** The day that "now" means: the present one, or the last whole one where days pass too fast to watch. */
export function dayNow() {
  const { slot, status } = view;
  if (!slot) return 0;
  const fast = status && status.slots_per_s > 0 && status.slots_per_day / status.slots_per_s < SHORT_DAY_S;
  return Math.max(fast && status.state === "running" ? slot.day - 1 : slot.day, 0);
}

export const past = { follow: true, day: 0, span: 1, rows: [], homes: new Map(), first: 0, dt: 1 };

/** Read what the charts show. */
export async function load(homes) {
  if (past.follow) past.day = dayNow();
  past.first = Math.max(past.day - past.span + 1, 0);
  const resolution = past.span === 1 ? "slot" : "hour";
  const query = `day=${past.first}&days=${past.day - past.first + 1}&resolution=${resolution}&limit=10000`;
  const [market, ...each] = await Promise.all([
    get(`/v1/history?${query}`),
    ...homes.map((id) => get(`/v1/prosumers/${id}/history?${query}`).catch(() => ({ rows: [] }))),
  ]);
  past.rows = market.rows;
  past.dt = resolution === "hour" ? Math.max(market.dt_h, 1) : market.dt_h;
  past.homes = new Map(homes.map((id, i) => [id, each[i].rows]));
}
