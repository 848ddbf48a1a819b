// The bars around the picture: what the page can be asked for.

import type { ToolSummary } from "../gen/kerf/v1/types_pb";
import type { StreamStatus } from "../net/frames";
import type { Style } from "../scene/tissue";
import { byId, element, type Icon, icon, iconButton } from "./dom";
import { title } from "./start";

/** What the bars ask for. */
export interface Actions {
  chooseScene(): void;
  changeScene(): void;
  share(): void;
  savePicture(): void;
  saveModel(): void;
  toggleTheme(): void;
  help(): void;
  take(toolId: number | undefined): void;
  putAway(): void;
  toggleJaws(): void;
  nudge(away: number, turn: number): void;
  togglePause(): void;
  step(): void;
  reset(): void;
  savePoint(): void;
  openPoints(): void;
  style(style: Style): void;
  showForces(shown: boolean): void;
}

const PHASES: Record<StreamStatus["phase"], string> = {
  connecting: "Connecting",
  live: "Live",
  lost: "Lost, trying again",
  moved: "Moved",
  ended: "Ended",
};
const STYLES: readonly (readonly [Style, string])[] = [
  ["tissue", "Tissue"],
  ["unadapted", "Not adapted"],
  ["wires", "Wires"],
  ["elements", "Elements"],
  ["voxels", "Voxels"],
  ["links", "Links"],
];
const HINT = "Drag to move, wheel for depth · Shift slices, Alt turns · double-click places · right button turns the view";
const TOUCH_HINT = "One finger moves the tool, two turn the view · tap twice to place it";

export class Bars {
  private readonly actions: Actions;
  private readonly sceneName = element("span", { className: "scene" });
  private readonly connection = element("span", { className: "connection", aria: { role: "status" } });
  private readonly pause: HTMLButtonElement;
  private readonly step: HTMLButtonElement;
  private readonly jaws: HTMLButtonElement;
  private readonly putAway: HTMLButtonElement;
  private readonly forces: HTMLButtonElement;
  private readonly styles = element("select", { aria: { label: "What is drawn" }, title: "What is drawn (V)" });
  private toolButtons: HTMLButtonElement[] = [];
  private tools: readonly ToolSummary[] = [];

  constructor(actions: Actions) {
    this.actions = actions;
    this.pause = iconButton("pause", "Pause", "Space", () => actions.togglePause());
    this.step = iconButton("step", "Step", ".", () => actions.step());
    this.jaws = iconButton("jaws", "Close or open the jaws", "C", () => actions.toggleJaws());
    this.putAway = iconButton("putAway", "Put the tool away", "Esc", () => actions.putAway());
    this.forces = iconButton("force", "Draw the forces", "F", () => this.toggleForces());
    this.forces.setAttribute("aria-pressed", "true");
    this.buildTop();
    this.buildTransport();
    byId("pad").append(
      this.padButton("away", "Away", 1, 0),
      this.padButton("near", "Nearer", -1, 0),
      this.padButton("turnLeft", "Turn left", 0, 1),
      this.padButton("turnRight", "Turn right", 0, -1),
    );
  }

  /** Another session. */
  showScene(name: string, tools: readonly ToolSummary[]): void {
    this.sceneName.textContent = title(name);
    document.title = `${title(name)} · Kerf`;
    this.tools = tools;
    const look = this.toolButton("look", "Look", () => this.actions.take(undefined));
    const buttons = tools.map(({ name, kind }, toolId) => {
      const button = this.toolButton((kind.case ?? "look"), title(name), () => this.actions.take(toolId));
      button.title = `Take the ${name} (${toolId + 1})`;
      return button;
    });
    this.toolButtons = [look, ...buttons];
    byId("tools").replaceChildren(...this.toolButtons);
    this.showTool(undefined);
  }

  showTool(toolId: number | undefined): void {
    this.toolButtons.forEach((button, i) => {
      button.setAttribute("aria-pressed", String(i === (toolId === undefined ? 0 : toolId + 1)));
    });
    const kind = toolId === undefined ? undefined : this.tools[toolId]?.kind.case;
    this.jaws.hidden = kind !== "grasper" && kind !== "scissors";
    this.putAway.hidden = toolId === undefined;
    document.body.classList.toggle("holding", toolId !== undefined);
    const isTouched = matchMedia("(pointer: coarse)").matches;
    byId("hint").textContent = toolId === undefined ? "" : isTouched ? TOUCH_HINT : HINT;
  }

  showJaws(areOpen: boolean): void {
    this.jaws.setAttribute("aria-pressed", String(!areOpen));
  }

  showStatus(status: StreamStatus): void {
    this.connection.dataset["phase"] = status.phase;
    this.connection.textContent = PHASES[status.phase];
    this.connection.title = "message" in status ? status.message : "";
  }

  showPaused(isPaused: boolean): void {
    this.pause.replaceChildren(icon(isPaused ? "play" : "pause"));
    this.pause.setAttribute("aria-label", isPaused ? "Go on" : "Pause");
    this.pause.setAttribute("aria-pressed", String(isPaused));
    this.step.disabled = !isPaused;
  }

  /** The way of drawing that is chosen. */
  get style(): Style {
    return this.styles.value as Style;
  }

  /** The next way of drawing. */
  nextStyle(): void {
    this.styles.selectedIndex = (this.styles.selectedIndex + 1) % STYLES.length;
    this.actions.style(this.style);
  }

  get showsForces(): boolean {
    return this.forces.getAttribute("aria-pressed") === "true";
  }

  toggleForces(): void {
    this.forces.setAttribute("aria-pressed", String(!this.showsForces));
    this.actions.showForces(this.showsForces);
  }

  private buildTop(): void {
    const { actions } = this;
    const readings = iconButton("readings", "All readings", "", () => byId("readings").classList.toggle("open"));
    readings.classList.add("narrow");
    byId("top").append(
      element("span", { className: "brand", textContent: "Kerf" }),
      this.sceneName,
      element("span", { className: "space" }),
      this.connection,
      iconButton("scenes", "Scenes and sessions", "", () => actions.chooseScene()),
      iconButton("settings", "Change the scene", "", () => actions.changeScene()),
      iconButton("share", "Copy a link to this session", "", () => actions.share()),
      readings,
      iconButton("theme", "Dark or light", "", () => actions.toggleTheme()),
      iconButton("help", "Help", "?", () => actions.help()),
    );
  }

  private buildTransport(): void {
    const { actions } = this;
    const gap = () => element("hr");
    this.styles.append(...STYLES.map(([value, textContent]) => element("option", { value, textContent })));
    this.styles.addEventListener("change", () => actions.style(this.style));
    byId("transport").append(
      this.pause,
      this.step,
      iconButton("reset", "Put the tissue back to rest", "R", () => actions.reset()),
      gap(),
      iconButton("point", "Save a point to go back to", "S", () => actions.savePoint()),
      iconButton("turnLeft", "Go back to a point", "B", () => actions.openPoints()),
      gap(),
      this.styles,
      this.forces,
      iconButton("picture", "Save a picture", "P", () => actions.savePicture()),
      iconButton("model", "Save the surface as GLB", "", () => actions.saveModel()),
      this.jaws,
      this.putAway,
    );
  }

  private toolButton(name: Icon, label: string, press: () => void): HTMLButtonElement {
    const button = element("button", { type: "button" }, icon(name), element("span", { textContent: label }));
    button.addEventListener("click", press);
    return button;
  }

  /** Goes on for as long as it is held. */
  private padButton(name: Icon, label: string, away: number, turn: number): HTMLButtonElement {
    const button = iconButton(name, label, "", () => {});
    let timer: ReturnType<typeof setInterval> | undefined;
    const stop = () => clearInterval(timer);
    button.addEventListener("pointerdown", () => {
      stop();
      this.actions.nudge(away, turn);
      timer = setInterval(() => this.actions.nudge(away, turn), 60);
    });
    for (const end of ["pointerup", "pointercancel", "pointerleave"]) button.addEventListener(end, stop);
    return button;
  }
}
