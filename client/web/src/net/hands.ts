// The page's end of the worker that drives tools: the page says where they are wanted.

import type { FromHandsWorker, ToHandsWorker } from "./hands-messages";
import { heldToken } from "./token";

/** Tools of one session as they are driven. A page has one session, so it has one worker. */
export class Hands {
  private static readonly worker = new Worker(new URL("./hands-worker.ts", import.meta.url), {
    type: "module",
    name: "kerf-hands",
  });

  constructor(sessionId: string, sceneSizeM: number, hear: (message: FromHandsWorker) => void) {
    Hands.worker.onmessage = ({ data }: MessageEvent<FromHandsWorker>) => hear(data);
    this.tell({ kind: "open", sessionId, sceneSizeM, token: heldToken() });
  }

  tell(message: ToHandsWorker): void {
    Hands.worker.postMessage(message);
  }
}
