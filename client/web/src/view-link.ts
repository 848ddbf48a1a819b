// The link to a session, with where one looks from: whoever opens it sees the same side of the tissue.

import { Vector3 } from "three";

/** Where the eye is and what it looks at, m in the scene's frame. */
export interface ViewPoint {
  eye: Vector3;
  target: Vector3;
}

/** Farther than this, m, is no view of a scene: the workspace is a metre about the origin. */
const FARTHEST_M = 20;

/** The address of a session on the page that `base` is. */
export function viewLink(base: string, sessionId: string, view?: ViewPoint): string {
  const url = new URL(base);
  url.search = "";
  url.searchParams.set("session", sessionId);
  if (view) url.searchParams.set("view", [view.eye, view.target].map(text).join(","));
  // Commas may stand in a query, and are read more easily.
  return url.href.replaceAll("%2C", ",");
}

/** The view that an address states, if it states one that can be looked from. */
export function viewOf(search: string): ViewPoint | undefined {
  const numbers = new URLSearchParams(search).get("view")?.split(",").map(Number) ?? [];
  const isPlace = (value: number) => Number.isFinite(value) && Math.abs(value) <= FARTHEST_M;
  if (numbers.length !== 6 || !numbers.every(isPlace)) return undefined;
  const view = { eye: new Vector3(...numbers.slice(0, 3)), target: new Vector3(...numbers.slice(3)) };
  return view.eye.distanceTo(view.target) > 0 ? view : undefined;
}

/** To a tenth of a millimetre. */
function text(place: Vector3): string {
  return place.toArray().map((value) => Number(value.toFixed(4))).join(",");
}
