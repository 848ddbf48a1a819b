// Keys and gestures.

import { openDialog } from "./dialog";
import { element } from "./dom";

const POINTER: readonly (readonly [string, string])[] = [
  ["Drag", "moves the tool; without a tool, turns the view"],
  ["Wheel", "moves the tool away or nearer; with Ctrl, or without a tool, the view"],
  ["Shift + drag", "slices: along the edge alone"],
  ["Alt + drag", "turns the tool"],
  ["Shift + Alt + drag", "draws a curve over the table: the edge turns after the drag"],
  ["Double-click, double tap", "puts the tool in hand down over that place"],
  ["Right button + drag", "turns the view while a tool is in hand; without one, moves it"],
  ["Middle button + drag", "moves the view while a tool is in hand; without one, comes nearer"],
  ["One finger", "moves the tool; without a tool, turns the view"],
  ["Two fingers", "turn and zoom the view"],
  ["Hold a button of the pad", "moves the tool away or nearer, or turns it, for as long as it is held"],
];

const KEYS: readonly (readonly [string, string])[] = [
  ["1 to 9", "take a tool"],
  ["Esc", "put it away"],
  ["Arrows", "move it sideways, up and down"],
  ["Page up, Page down", "move it away, nearer"],
  ["Q, E", "turn it"],
  ["T, G", "tip it"],
  ["C", "close or open its jaws"],
  ["Space", "pause or go on"],
  [".", "take one step"],
  ["R", "put the tissue back to rest"],
  ["S", "save a point"],
  ["B", "go back to a point"],
  ["V", "tissue, not adapted to the blade, wires, elements, voxels, links"],
  ["F", "draw the forces, or not"],
  ["P", "save a picture"],
  ["?", "this list"],
];

export function openHelp(): void {
  const table = (rows: typeof KEYS) =>
    element(
      "dl",
      {},
      ...rows.flatMap(([keys, does]) => [
        element("dt", {}, element("kbd", { textContent: keys })),
        element("dd", { textContent: does }),
      ]),
    );
  openDialog(
    "Mouse, fingers and keys",
    element("h2", { textContent: "Mouse and fingers" }),
    table(POINTER),
    element("h2", { textContent: "Keys" }),
    table(KEYS),
  );
}
