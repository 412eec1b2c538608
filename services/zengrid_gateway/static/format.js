// How numbers are written: one place, so that the page speaks with one voice.
const fixed = (digits) => new Intl.NumberFormat("en", { minimumFractionDigits: digits, maximumFractionDigits: digits });
const [whole, one, two] = [fixed(0), fixed(1), fixed(2)];
const MINUS = "\u2212";
const signed = (text) => text.replace("-", MINUS);

export const cents = (dollars) => signed(one.format(100 * dollars));
export const count = (n) => whole.format(n);
export const kw = (power) => signed((Math.abs(power) >= 100 ? whole : one).format(tidy(power))) + " kW";
export const signedKw = (power) => (tidy(power) > 0 ? "+" : "") + kw(power);
export const percent = (fraction) => whole.format(100 * fraction) + " %";
export const clock = (hour) => {
  const minutes = Math.round(hour * 60);
  return `${String(Math.floor(minutes / 60) % 24).padStart(2, "0")}:${String(minutes % 60).padStart(2, "0")}`;
};

export function money(dollars) {
  const text = (Math.abs(dollars) >= 1000 ? whole : two).format(Math.abs(dollars));
  return (dollars < 0 && Number(text.replaceAll(",", "")) ? MINUS : "") + "$" + text;
}

/** Relative change such as "−38 %", or by how much where a ratio says little; null where there is nothing to compare. */
export function change(value, conventional, show = money) {
  if (Math.abs(conventional) < 1e-9 && Math.abs(value) < 1e-9) return null;
  const fraction = (value - conventional) / Math.max(Math.abs(conventional), 1e-9);
  if (Math.abs(fraction) > 2) return { fraction, text: (fraction > 0 ? "+" : "") + show(value - conventional) };
  const text = Math.abs(fraction) < 0.0995 ? one.format(100 * fraction) : whole.format(100 * fraction);
  return { fraction, text: (fraction > 0.0005 ? "+" : "") + signed(text.replace(/^-0\.0$/, "0.0")) + " %" };
}

/** 0.03 kW of rounding is nothing that a reader should see a sign of. */
export const tidy = (power) => (Math.abs(power) < 0.05 ? 0 : power);
