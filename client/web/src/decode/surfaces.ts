// The surfaces of all objects, of which those are made anew that a change of the structure has changed.

import type { Body } from "./body";
import { BodySurface, type SurfaceStructure } from "./surface";

export class Surfaces {
  private surfaces: BodySurface[] = [];

  /** One for each object. */
  get all(): readonly BodySurface[] {
    return this.surfaces;
  }

  /**
   * To be called after each change of the structure; answers with what is new, by object. Seams that are new are of the sim
   * time `nowS`.
   */
  follow(bodies: readonly Body[], nowS?: number): (SurfaceStructure | undefined)[] {
    this.surfaces = bodies.map((body, index) => {
      const before = this.surfaces.at(index);
      return before?.body === body ? before : new BodySurface(body, before);
    });
    return this.surfaces.map((surface) => (surface.isStale ? surface.restructure(nowS) : undefined));
  }
}
