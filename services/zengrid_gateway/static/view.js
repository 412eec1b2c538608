// What the page knows of the market at this moment.
export const view = {
  gateway: false, // whether the gateway answers
  present: false, // whether the market is there
  slot: null, // the slot settled last, as it was published
  status: null, // /v1/market
  homes: [], // /v1/prosumers, as many as are shown
  total: 0, // how many there are
  scenario: null, // /v1/scenario
  spawners: [], // /v1/spawners
  chosen: null, // ids of the homes that the charts show; null: the first few
};

const FEW = 6;

/** The homes that the charts show. */
export function charted() {
  const ids = view.homes.map((home) => home.id);
  return view.chosen ? ids.filter((id) => view.chosen.has(id)) : ids.slice(0, FEW);
}

/** Show or hide a home in the charts. */
export function toggleHome(id) {
  const chosen = new Set(charted());
  if (!chosen.delete(id)) chosen.add(id);
  view.chosen = chosen;
}

/** Place of a home in the market: gives it its colour. */
export const place = (id) => view.homes.findIndex((home) => home.id === id);
