// Mouse, fingers, wheel and keys over the canvas, as what they do to the tool in hand.

import { MOUSE, TOUCH } from "three";
import type { Grip } from "./hand";
import type { Stage } from "./scene/stage";
import type { Session } from "./session";

/** A step of a key, in sizes of the scene, and in rad. */
const NUDGE = 0.012;
const TWIST_RAD = 0.06;
/** Wheel units to sizes of the scene. */
const WHEEL = 0.00025;

/** Keys that move the tool: right, up, away in steps, or turns about the vertical and across the screen. */
const MOVES: Record<string, readonly [number, number, number]> = {
  ArrowLeft: [-1, 0, 0],
  ArrowRight: [1, 0, 0],
  ArrowUp: [0, 1, 0],
  ArrowDown: [0, -1, 0],
  PageUp: [0, 0, 1],
  PageDown: [0, 0, -1],
};
const TURNS: Record<string, readonly [number, number]> = { q: [1, 0], e: [-1, 0], t: [0, 1], g: [0, -1] };

export class Input {
  private readonly stage: Stage;
  private readonly session: () => Session | undefined;
  private drag: { pointerId: number; x: number; y: number } | undefined;

  constructor(stage: Stage, session: () => Session | undefined) {
    this.stage = stage;
    this.session = session;
    const { canvas } = stage;
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", () => (this.drag = undefined));
    canvas.addEventListener("pointercancel", () => (this.drag = undefined));
    canvas.addEventListener("dblclick", (event) => this.placeAt(event));
    // Before the camera's own, which hears of it only without a tool in hand.
    canvas.addEventListener("wheel", (event) => this.wheel(event), { capture: true, passive: false });
    this.suit(false);
  }

  /** What buttons and fingers do to the view, while a tool is in hand or not. */
  suit(isHolding: boolean): void {
    const { controls, canvas } = this.stage;
    controls.mouseButtons = isHolding
      ? { LEFT: null, MIDDLE: MOUSE.PAN, RIGHT: MOUSE.ROTATE }
      : { LEFT: MOUSE.ROTATE, MIDDLE: MOUSE.DOLLY, RIGHT: MOUSE.PAN };
    controls.touches = { ONE: isHolding ? null : TOUCH.ROTATE, TWO: TOUCH.DOLLY_ROTATE };
    canvas.classList.toggle("holding", isHolding);
    this.drag = undefined;
  }

  /** A key that moves the tool in hand; says whether it was one. */
  key(event: KeyboardEvent): boolean {
    const hand = this.session()?.hand;
    const move = MOVES[event.key];
    const turn = TURNS[event.key.toLowerCase()];
    if (!hand || !(move || turn)) return false;
    const { camera } = this.stage;
    if (move) hand.nudge(NUDGE * move[0], NUDGE * move[1], NUDGE * move[2], camera);
    if (turn) hand.twist(TWIST_RAD * turn[0], TWIST_RAD * turn[1], camera);
    return true;
  }

  /** What the buttons for fingers do. */
  nudge(away: number, turn: number): void {
    const hand = this.session()?.hand;
    hand?.nudge(0, 0, NUDGE * away, this.stage.camera);
    hand?.twist(2 * TWIST_RAD * turn, 0, this.stage.camera);
  }

  private press(event: PointerEvent): void {
    this.stage.canvas.focus();
    // A second finger turns the view.
    if (!event.isPrimary) this.drag = undefined;
    if (!event.isPrimary || event.button !== 0 || !this.session()?.hand) return;
    this.drag = { pointerId: event.pointerId, x: event.clientX, y: event.clientY };
    this.stage.canvas.setPointerCapture(event.pointerId);
  }

  private move(event: PointerEvent): void {
    const hand = this.session()?.hand;
    if (!this.drag || this.drag.pointerId !== event.pointerId || !hand) return;
    const { canvas, camera } = this.stage;
    const [withoutAlt, withAlt]: [Grip, Grip] = event.shiftKey ? ["slice", "draw"] : ["move", "turn"];
    const grip = event.altKey ? withAlt : withoutAlt;
    hand.drag(grip, event.clientX - this.drag.x, event.clientY - this.drag.y, camera, canvas.clientHeight);
    this.drag = { pointerId: event.pointerId, x: event.clientX, y: event.clientY };
  }

  private wheel(event: WheelEvent): void {
    const hand = this.session()?.hand;
    if (!hand || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1;
    hand.nudge(0, 0, -WHEEL * lines * event.deltaY, this.stage.camera);
  }

  private placeAt(event: MouseEvent): void {
    const { left, top, width, height } = this.stage.canvas.getBoundingClientRect();
    const across = (event.clientX - left) / width;
    const down = (event.clientY - top) / height;
    this.session()?.placeAt(2 * across - 1, 1 - 2 * down);
  }
}
