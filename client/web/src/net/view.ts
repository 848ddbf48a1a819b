// The page's end of the view worker.

import { shapeArrays, type SurfaceShape } from "../decode/surface";
import type { Frame, FromWorker, SessionEvent, StreamStatus, ToWorker, Wants } from "./frames";
import { heldToken } from "./token";

/** Who is told of a session. */
export interface ViewListener {
  /** Draws the frame; answers with arrays that it needs no more, one entry per object. */
  onFrame(frame: Frame): SurfaceShape[];
  onStatus(status: StreamStatus): void;
  onEvent(event: SessionEvent): void;
  onFault(object: string, step: number): void;
}

/** A session as it is watched. */
export class View {
  private readonly worker: Worker;
  private readonly listener: ViewListener;
  private newest: Frame | undefined;

  constructor(listener: ViewListener) {
    this.listener = listener;
    this.worker = new Worker(new URL("./view-worker.ts", import.meta.url), { type: "module", name: "kerf-view" });
    this.worker.onmessage = ({ data }: MessageEvent<FromWorker>) => this.hear(data);
  }

  open(sessionId: string): void {
    this.newest = undefined;
    this.send({ kind: "open", sessionId, server: location.origin, token: heldToken() });
  }

  close(): void {
    this.newest = undefined;
    this.send({ kind: "close" });
  }

  /** What frames are to carry from now on. */
  want(wants: Wants): void {
    this.send({ kind: "want", wants });
  }

  /** Hands on the newest frame, if one has come since the last call: to be called once a picture. */
  takeFrame(): boolean {
    const frame = this.newest;
    if (!frame) return false;
    this.newest = undefined;
    const shapes = this.listener.onFrame(frame);
    const buffers = shapes.flatMap(shapeArrays).map((array) => array.buffer);
    this.worker.postMessage({ kind: "drawn", shapes } satisfies ToWorker, buffers);
    return true;
  }

  private hear(message: FromWorker): void {
    switch (message.kind) {
      case "frame":
        this.newest = message.frame;
        break;
      case "status":
        this.listener.onStatus(message.status);
        break;
      case "event":
        this.listener.onEvent(message.event);
        break;
      case "fault":
        this.listener.onFault(message.object, message.step);
    }
  }

  private send(message: ToWorker): void {
    this.worker.postMessage(message);
  }
}
