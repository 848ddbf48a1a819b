// Asks again and again what lies beneath the surface, while somebody looks at it.

import type { GetInteriorResponse } from "../gen/kerf/v1/view_pb";
import { views } from "./server";

/** The server puts an answer together five times a second. */
const EVERY_MS = 200;

export interface InteriorListener {
  onInterior(object: number, told: GetInteriorResponse): void;
  /** It will not be told: the object is too large, or the session is a recording. Nothing more is asked. */
  onRefused(error: unknown): void;
}

export class Interiors {
  private asking: symbol | undefined;
  private readonly sessionId: string;
  private readonly objects: number;
  private readonly listener: InteriorListener;

  constructor(sessionId: string, objects: number, listener: InteriorListener) {
    this.sessionId = sessionId;
    this.objects = objects;
    this.listener = listener;
  }

  start(): void {
    if (this.asking) return;
    const mine = (this.asking = Symbol("asking"));
    void this.ask(() => this.asking === mine);
  }

  stop(): void {
    this.asking = undefined;
  }

  private async ask(isWanted: () => boolean): Promise<void> {
    while (isWanted()) {
      try {
        for (let object = 0; object < this.objects; object++) {
          const told = await views.getInterior({ sessionId: this.sessionId, object });
          if (isWanted()) this.listener.onInterior(object, told);
        }
      } catch (error) {
        if (isWanted()) this.listener.onRefused(error);
        return;
      }
      await new Promise((resolve) => setTimeout(resolve, EVERY_MS));
    }
  }
}
