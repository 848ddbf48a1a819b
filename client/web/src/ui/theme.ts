// Dark, in which tissue is seen best, or light, for those who choose it.

import type { Backdrop } from "../scene/stage";

const KEY = "kerf-theme";
const BACKDROPS: Record<string, Backdrop> = {
  dark: { middle: "#2a313b", rim: "#0c0e12", table: "#3a424d" },
  light: { middle: "#f7f8fa", rim: "#c9d0d8", table: "#d5dbe2" },
};

function chosen(): string {
  return localStorage.getItem(KEY) === "light" ? "light" : "dark";
}

/** Applies the theme now and whenever it is changed. */
export function followTheme(apply: (backdrop: Backdrop) => void): { toggle: () => void } {
  const show = () => {
    document.documentElement.dataset["theme"] = chosen();
    apply(BACKDROPS[chosen()]);
  };
  show();
  const toggle = () => {
    localStorage.setItem(KEY, chosen() === "dark" ? "light" : "dark");
    show();
  };
  return { toggle };
}
