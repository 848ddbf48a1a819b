// The page without a framework: elements from a tag, properties and children.

type Child = Node | string | false | undefined;
type Properties<T extends HTMLElement> = Partial<Omit<T, "style" | "dataset" | "children">> & {
  data?: Record<string, string>;
  aria?: Record<string, string>;
};

export function element<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  { data = {}, aria = {}, ...properties }: Properties<HTMLElementTagNameMap[K]> = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const made = document.createElement(tag);
  Object.assign(made, properties);
  Object.assign(made.dataset, data);
  for (const [name, value] of Object.entries(aria)) made.setAttribute(name === "role" ? name : `aria-${name}`, value);
  made.append(...children.filter((child): child is Node | string => child !== false && child !== undefined));
  return made;
}

/** Writes a text into an element that says another: with every change the browser puts the whole page together anew. */
export function write(into: HTMLElement, text: string): void {
  if (into.textContent !== text) into.textContent = text;
}

/** The element of the page that has this id. */
export function byId(id: string): HTMLElement {
  const found = document.getElementById(id);
  if (!found) throw new Error(`the page has no #${id}`);
  return found;
}

const ICONS = {
  look: "M2 12s4-7 10-7 10 7 10 7-4 7-10 7S2 12 2 12zm10-3a3 3 0 1 0 0 6 3 3 0 0 0 0-6z",
  blade: "M4 20 16 4c3 1 4 4 3 7l-9 7zM4 20l4-1",
  scissors: "M20 4 8 16m12 4L8 8m-2 1a2.5 2.5 0 1 0 0-5 2.5 2.5 0 0 0 0 5zm0 11a2.5 2.5 0 1 0 0-5 2.5 2.5 0 0 0 0 5z",
  grasper: "M12 3v7m0 0c-4 1-5 5-3 11m3-11c4 1 5 5 3 11",
  probe: "M12 3v11m0 7a3.5 3.5 0 1 0 0-7 3.5 3.5 0 0 0 0 7z",
  pause: "M8 5v14M16 5v14",
  play: "M7 4l13 8-13 8z",
  step: "M5 5l9 7-9 7zM18 5v14",
  reset: "M4 11a8 8 0 1 1 2 6m-2-6V5m0 6h6",
  point: "M6 3h12v18l-6-5-6 5z",
  picture: "M4 7h4l2-3h4l2 3h4v13H4zm8 2.5a4 4 0 1 0 0 8 4 4 0 0 0 0-8z",
  model: "M12 3l8 4.5v9L12 21l-8-4.5v-9zm0 9l8-4.5M12 12v9m0-9L4 7.5",
  share: "M14 4h6v6m0-6-9 9M18 14v6H4V6h6",
  theme: "M12 3a9 9 0 1 0 9 9c-5 2-11-3-9-9z",
  help: "M9 9a3 3 0 1 1 4 3c-1 .5-1 1-1 2m0 3v.5M12 21a9 9 0 1 0 0-18 9 9 0 0 0 0 18z",
  settings: "M4 7h10m4 0h2M4 17h2m4 0h10M16 5v4M8 15v4",
  scenes: "M4 4h7v7H4zm9 0h7v7h-7zM4 13h7v7H4zm9 0h7v7h-7z",
  jaws: "M4 12c4-7 12-7 16-3M4 12c4 7 12 7 16 3",
  away: "M12 20V5m-6 6 6-6 6 6",
  near: "M12 4v15m-6-6 6 6 6-6",
  turnLeft: "M5 9a8 8 0 1 1-1 6M5 3v6h6",
  turnRight: "M19 9a8 8 0 1 0 1 6m-1-12v6h-6",
  shape: "M12 3l9 6-3.5 11h-11L3 9z",
  readings: "M3 17l5-6 4 4 8-10",
  force: "M12 20V6m-5 5 5-5 5 5M5 21h14",
  putAway: "M6 6l12 12M18 6 6 18",
} as const;

export type Icon = keyof typeof ICONS;

export function icon(name: Icon): SVGSVGElement {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  path.setAttribute("d", ICONS[name]);
  svg.append(path);
  return svg;
}

/** A button with an icon; its name is read out and shown as a tip, with its key. */
export function iconButton(name: Icon, label: string, key: string, press: () => void): HTMLButtonElement {
  const tip = key === "" ? label : `${label} (${key})`;
  const button = element("button", { type: "button", className: "icon", title: tip, aria: { label } }, icon(name));
  button.addEventListener("click", press);
  return button;
}

export function textButton(label: string, press: () => void, className = ""): HTMLButtonElement {
  const button = element("button", { type: "button", className, textContent: label });
  button.addEventListener("click", press);
  return button;
}
