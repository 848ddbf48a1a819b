// What the colours of voxels and links stand for.

import { RAMP } from "../scene/interior";
import { byId, element } from "./dom";
import { withUnit } from "./numbers";

/** Shows the scale; the last colour stands for the most that an element of each object has held, J/m^3. */
export function showLegend(mostJPerM3: readonly number[]): void {
  const most = mostJPerM3.map((energy) => withUnit(energy, "J/m³")).join(" · ");
  const bar = element("div", { className: "ramp" });
  // Colours stand by the root of the energy, so the middle of the bar is a quarter of it.
  bar.style.background = `linear-gradient(to right, ${RAMP.join(", ")})`;
  const legend = byId("legend");
  legend.hidden = false;
  legend.replaceChildren(
    element("span", { textContent: "Elastic energy: 0" }),
    bar,
    element("output", { textContent: most, title: "The most that any element has held" }),
  );
}

export function hideLegend(): void {
  byId("legend").hidden = true;
}
