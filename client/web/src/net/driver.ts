// Drives tools by single calls. One call is under way at a time and the newest pose of each tool is the one that
// is sent: nothing is queued, however slow the network.

import { Code, ConnectError } from "@connectrpc/connect";
import { ContactFlag, type SendPoseResponse } from "../gen/kerf/v1/control_pb";
import type { DrivenPose } from "./hands-messages";
import { inWords } from "./errors";
import { control } from "./server";

/** A tool holds still at least this often, so that its lease goes on, ms. */
const KEEP_ALIVE_MS = 400;

/** Who is told what became of poses. A lost connection is the stream's to report. */
export interface DriverListener {
  onRoundTrip(milliseconds: number): void;
  /** The jaws let go of what they held: it took more force than they have. */
  onSlipped(toolId: number): void;
  /** The tool is kept out of tissue that it has not come into by moving, or is not any more. */
  onWaits(toolId: number, waits: boolean): void;
  /** The tool is not to be had; it was put away. */
  onRefused(toolId: number, why: string): void;
}

interface Driven {
  /** Absent: the tool is to be lifted. */
  pose?: DrivenPose;
  /** It is lifted before it goes there, so that it touches nothing on the way. */
  liftFirst?: boolean;
  isNew: boolean;
  sentMs: number;
}

/** Drives the tools of one session. */
export class Driver {
  private readonly sessionId: string;
  private readonly listener: DriverListener;
  private readonly tools = new Map<number, Driven>();
  private readonly timer: ReturnType<typeof setInterval>;
  private lease = "";
  private seq = 0n;
  private isBusy = false;

  constructor(sessionId: string, listener: DriverListener) {
    this.sessionId = sessionId;
    this.listener = listener;
    this.timer = setInterval(() => this.pump(), KEEP_ALIVE_MS / 4);
  }

  /** Where a tool is to be now. */
  move(toolId: number, pose: DrivenPose): void {
    const liftFirst = this.tools.get(toolId)?.liftFirst ?? false;
    this.tools.set(toolId, { pose, liftFirst, isNew: true, sentMs: 0 });
    this.pump();
  }

  /** Puts a tool down somewhere, through the air. */
  put(toolId: number, pose: DrivenPose): void {
    this.tools.set(toolId, { pose, liftFirst: true, isNew: true, sentMs: 0 });
    this.pump();
  }

  /** Takes a tool out of the scene. */
  lift(toolId: number): void {
    if (!this.tools.has(toolId)) return;
    this.tools.set(toolId, { isNew: true, sentMs: 0 });
    this.pump();
  }

  /** Lifts every tool and sends no more. */
  end(): void {
    clearInterval(this.timer);
    for (const toolId of this.tools.keys()) this.lift(toolId);
  }

  private pump(): void {
    if (this.isBusy) return;
    const now = performance.now();
    const due = [...this.tools].find(([, tool]) => tool.isNew || now - tool.sentMs > KEEP_ALIVE_MS);
    if (due) void this.send(...due);
  }

  private async send(toolId: number, tool: Driven): Promise<void> {
    this.isBusy = true;
    const begun = performance.now();
    const { pose, liftFirst = false } = tool;
    // Behind the others, so that each gets its turn.
    this.tools.delete(toolId);
    if (pose) this.tools.set(toolId, { pose, isNew: liftFirst, sentMs: begun });
    try {
      const request = this.request(toolId, liftFirst ? undefined : pose);
      this.hear(toolId, await control.sendPose(request, { timeoutMs: 5000 }));
      this.listener.onRoundTrip(performance.now() - begun);
    } catch (error) {
      this.fail(toolId, error);
    }
    this.isBusy = false;
    if ([...this.tools.values()].some((waiting) => waiting.isNew)) this.pump();
  }

  private request(toolId: number, pose: DrivenPose | undefined) {
    const { sessionId, lease } = this;
    if (!pose) return { sessionId, lease, motion: { case: "lift" as const, value: { toolId } } };
    const [x, y, z] = pose.position;
    const [qx, qy, qz, w] = pose.orientation;
    this.seq += 1n;
    const value = {
      toolId,
      seq: this.seq,
      clientNs: BigInt(Math.round(performance.now() * 1e6)),
      pose: { positionM: { x, y, z }, orientation: { x: qx, y: qy, z: qz, w } },
      opening: pose.opening,
    };
    return { sessionId, lease, motion: { case: "pose" as const, value } };
  }

  private hear(toolId: number, { lease, contact, rejected }: SendPoseResponse): void {
    this.lease = lease;
    if (rejected?.field === "tool_id") this.refuse(toolId, "Somebody else holds this tool.");
    if (!contact) return;
    if (contact.flags & ContactFlag.SLIPPED) this.listener.onSlipped(toolId);
    this.listener.onWaits(toolId, (contact.flags & ContactFlag.WAITS_UNTIL_CLEAR) !== 0);
  }

  private fail(toolId: number, error: unknown): void {
    const { code } = ConnectError.from(error);
    if (code === Code.FailedPrecondition && this.lease !== "") {
      // The lease ran out while nothing could be sent, or another hand took the tool: the next call asks anew.
      this.lease = "";
    } else if (code === Code.FailedPrecondition) {
      this.refuse(toolId, "Somebody else holds this tool.");
    } else if (code === Code.PermissionDenied || code === Code.Unauthenticated) {
      this.refuse(toolId, inWords(error));
    } else {
      this.tools.delete(toolId);
    }
  }

  private refuse(toolId: number, why: string): void {
    this.tools.delete(toolId);
    this.listener.onRefused(toolId, why);
  }
}
