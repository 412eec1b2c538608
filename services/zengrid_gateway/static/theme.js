// Dark or light: as the system has it until the reader chooses.
const KEY = "zengrid-theme";
const system = matchMedia("(prefers-color-scheme: dark)");

function apply() {
  document.documentElement.dataset.theme = localStorage.getItem(KEY) || (system.matches ? "dark" : "light");
  dispatchEvent(new Event("theme"));
}

export function start() {
  system.addEventListener("change", apply);
  document.getElementById("theme").addEventListener("click", () => {
    const dark = document.documentElement.dataset.theme === "dark";
    localStorage.setItem(KEY, dark ? "light" : "dark");
    apply();
  });
  apply();
}

/** A colour of the present theme. */
export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

const HOMES = {
  light: ["#0d8a7f", "#c2680a", "#6d5bd0", "#b83280", "#3b6fb6", "#7a8f1f", "#a0522d", "#4a6572"],
  dark: ["#3fd0c0", "#f0a64a", "#a99bff", "#f07cc0", "#7fb0f0", "#b9cf57", "#d99a70", "#9fb6c3"],
};

/** The colour of the nth home, everywhere the same. */
export const homeColour = (n) => HOMES[document.documentElement.dataset.theme][n % HOMES.light.length];
