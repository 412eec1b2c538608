// The first glance: price, who sells, reserve, and whether it is better than without demand response.
import { cents, change, count, kw, signedKw, tidy } from "./format.js";

const $ = (id) => document.getElementById(id);
const SHOWN = 5;
const SAME = 0.005; // half a percent is no difference to speak of
const text = (id, value) => { const node = $(id); if (node.textContent !== value) node.textContent = value; };
const sum = (values) => values.reduce((a, b) => a + b, 0);

export function drawPrice(slot, day) {
  text("buy", cents(slot.buy_price));
  text("sell", cents(slot.sell_price));
  const gap = slot.sell_price - slot.buy_price;
  text("spread", Math.abs(gap) < 5e-5 ? ", the same" : `, ${cents(Math.abs(gap))} ${gap > 0 ? "more" : "less"}`);
  $("price-line").innerHTML = spark(day);
}

/** Both prices over the day so far, as two stepped lines. */
function spark(rows) {
  if (!rows.length) return "";
  const dt = rows.length > 1 ? rows[1].hour - rows[0].hour : 24 - rows[0].hour;
  const prices = rows.flatMap((row) => [row.buy_price, row.sell_price]);
  const [low, high] = [Math.min(...prices), Math.max(...prices)];
  const y = (price) => (40 - 36 * (price - low) / Math.max(high - low, 1e-9)).toFixed(1);
  const path = (name) => rows.map((row, i) => `${i ? "V" : `M${row.hour * 10} `}${y(row[name])}H${(row.hour + dt) * 10}`).join("");
  const line = (name, colour) => `<path d="${path(name)}" fill="none" stroke="var(--${colour})" stroke-width="2" vector-effect="non-scaling-stroke"/>`;
  return line("sell_price", "sell") + line("buy_price", "buy");
}

export function drawSelling(slot, homes, total) {
  const net = (home) => tidy(home.injection_kw);
  const selling = homes.filter((home) => net(home) > 0);
  const buying = homes.filter((home) => net(home) < 0);
  const all = homes.length === total;
  text("selling", all ? count(selling.length) : kw(slot.export_kw));
  text("selling-of", all ? `of ${count(total)} home${total === 1 ? "" : "s"}` : "");
  text("selling-text", all ? trade(selling.map(net), buying.map(net)) : `is what ${count(total)} homes sell together`);
  const shown = [...homes].sort((a, b) => Math.abs(net(b)) - Math.abs(net(a))).slice(0, SHOWN)
    .sort((a, b) => homes.indexOf(a) - homes.indexOf(b));
  const scale = Math.max(2, ...shown.map((home) => Math.abs(net(home))));
  $("flows").setAttribute("aria-label", shown.map((home) => `${home.id} ${describe(net(home))}`).join(", "));
  $("flows").innerHTML = shown.map((home) => flow(home.id, net(home), scale)).join("");
}

function trade(sold, bought) {
  const who = (powers, verb) => `${count(powers.length)} ${verb}${powers.length === 1 ? "s" : ""} ${kw(Math.abs(sum(powers)))}`;
  if (!sold.length) return bought.length ? `Nobody: ${who(bought, "buy")}` : "Nobody sells or buys: they live on their own power";
  return bought.length ? `${who(sold, "sell")}, ${who(bought, "buy")}` : `Together ${kw(sum(sold))}`;
}

const describe = (power) => (power > 0 ? `sells ${kw(power)}` : power < 0 ? `buys ${kw(-power)}` : "neither buys nor sells");

function flow(id, power, scale) {
  const width = 50 * Math.abs(power) / scale;
  const left = power > 0 ? 50 : 50 - width;
  const way = power > 0 ? "sells" : power < 0 ? "buys" : "rests";
  return `<div class="flow" data-way="${way}"><span class="name">${id}</span>` +
    `<span class="axis"><i style="left:${left}%;width:${width}%"></i></span><span class="kw num">${signedKw(power)}</span></div>`;
}

export function drawReserve(slot, conventional, most) {
  const base = slot.facility_kw[0] ?? 0;
  const reserve = sum(slot.facility_kw.slice(1));
  const on = tidy(reserve) > 0;
  document.querySelector(".tile.reserve").dataset.on = on;
  text("reserve", on ? "Yes" : "No");
  text("reserve-kw", on ? kw(reserve) : "");
  const without = conventional ? sum(conventional.slice(1)) : null;
  if (without !== null) text("reserve-text", compare(reserve, without));
  const scale = Math.max(most || 0, base + reserve + slot.export_kw, without === null ? 0 : sum(conventional), 1);
  const mark = without === null ? "" : `<span class="ghost" style="left:calc(${100 * sum(conventional) / scale}% - 1px)" title="without demand response"></span>`;
  const parts = [["base", base], ["reserve", reserve], ["homes", slot.export_kw]];
  const shown = parts.filter(([name, power]) => name === "base" || tidy(power) > 0);
  $("supply").innerHTML = shown.map(([name, power]) => `<i class="${name}" style="width:${100 * power / scale}%"></i>`).join("") + mark;
  const supply = shown.map(([name, power]) => `${name} ${kw(power)}`).join(" + ");
  $("supply").setAttribute("aria-label", supply);
  text("supply-text", `${supply} for ${kw(slot.demand_kw)} of demand`.replace(/^b/, "B"));
}

function compare(reserve, without) {
  if (!tidy(reserve) && !tidy(without)) return "nor would it without demand response";
  if (!tidy(without)) return "without demand response it would rest";
  if (!tidy(reserve - without)) return "as much as without demand response";
  return `without demand response: ${kw(without)}`;
}

export function drawBetter(totals, slotsPerDay) {
  const figures = [
    ["d-bills", change(totals.bills, totals.baseline_bills), -1],
    ["d-profit", change(totals.profit, totals.baseline_profit), 1],
    ["d-reserve", change(totals.reserve_kwh, totals.baseline_reserve_kwh, (kwh) => signedKw(kwh).replace("+", "") + "h"), -1],
  ];
  const verdicts = figures.map(([id, delta, wanted]) => {
    text(id, delta === null ? "–" : delta.text);
    const good = delta === null || Math.abs(delta.fraction) < SAME ? null : delta.fraction * wanted > 0;
    if (good === null) delete $(id).dataset.good; else $(id).dataset.good = good;
    return good;
  });
  const better = verdicts.filter((good) => good === true).length;
  const worse = verdicts.filter((good) => good === false).length;
  const verdict = worse ? (better ? "mixed" : "no") : better ? "yes" : "same";
  document.querySelector(".tile.better").dataset.verdict = verdict;
  text("verdict", { yes: "Yes", no: "No", mixed: "Partly", same: "The same" }[verdict]);
  const days = totals.slots / slotsPerDay;
  const span = days < 1 ? `${count(totals.slots)} slot${totals.slots === 1 ? "" : "s"}` : `${count(Math.floor(days))} day${days < 2 ? "" : "s"}`;
  text("since", `Since the first slot, ${span} ago`);
}
