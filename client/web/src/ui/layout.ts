// Bars that wrap are as high as they come out: what stands beside them is told.

import { byId } from "./dom";

/** Bars whose heights the style sheet needs, as `--NAME-height`. */
const MEASURED = ["top", "readings", "tools", "transport"] as const;

export function followLayout(): void {
  const { style } = document.documentElement;
  const told = new ResizeObserver(() => {
    for (const name of MEASURED) style.setProperty(`--${name}-height`, `${byId(name).offsetHeight}px`);
  });
  for (const name of MEASURED) told.observe(byId(name), { box: "border-box" });
}
