// Dark or light, as the system prefers it or as it was chosen on the page.

import type { Backdrop } from "../scene/stage";

const KEY = "kerf-theme";
const BACKDROPS: Record<string, Backdrop> = {
  dark: { middle: "#2a313b", rim: "#0c0e12", table: "#3a424d" },
  light: { middle: "#f7f8fa", rim: "#c9d0d8", table: "#d5dbe2" },
};

const prefersLight = matchMedia("(prefers-color-scheme: light)");

/** What was chosen on this page, else what the system prefers. */
function shown(): string {
  return localStorage.getItem(KEY) ?? (prefersLight.matches ? "light" : "dark");
}

/** Applies the theme now and whenever it is changed, here or in the system. */
export function followTheme(apply: (backdrop: Backdrop) => void): { toggle: () => void } {
  const show = () => {
    const theme = shown() === "light" ? "light" : "dark";
    document.documentElement.dataset["theme"] = theme;
    apply(BACKDROPS[theme]);
  };
  show();
  prefersLight.addEventListener("change", show);
  const toggle = () => {
    localStorage.setItem(KEY, shown() === "light" ? "dark" : "light");
    show();
  };
  return { toggle };
}
