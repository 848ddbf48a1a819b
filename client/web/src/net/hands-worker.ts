// Moves tools towards where they are wanted and sends their poses, beside the page's own thread: a page that draws slowly
// does not make a tool jump.

/// <reference lib="webworker" />
import { Driver } from "./driver";
import { Follower } from "./follower";
import type { FromHandsWorker, ToHandsWorker } from "./hands-messages";
import { sayToken } from "./token";

/** Poses come twice as often as pictures, ms: a tool goes in smaller steps, and a call costs a browser half of one. */
const EVERY_MS = 8;
/** A pause that was longer does not throw tools ahead, s. */
const LONGEST_TICK_S = 0.1;

const scope = self as unknown as DedicatedWorkerGlobalScope;

let driver: Driver | undefined;
let sceneSizeM = 1;
const followers = new Map<number, Follower>();
/** Tools that are kept out of tissue, as the page was told. */
const waiting = new Set<number>();

const post = (message: FromHandsWorker) => scope.postMessage(message);

scope.onmessage = ({ data }: MessageEvent<ToHandsWorker>) => {
  switch (data.kind) {
    case "open":
      end();
      sayToken(data.token);
      sceneSizeM = data.sceneSizeM;
      driver = new Driver(data.sessionId, {
        onRoundTrip: (milliseconds) => post({ kind: "roundTrip", milliseconds }),
        onSlipped: () => post({ kind: "slipped" }),
        onWaits: (toolId, waits) => {
          if (waits && !waiting.has(toolId)) post({ kind: "waits" });
          if (waits) waiting.add(toolId);
          else waiting.delete(toolId);
        },
        onRefused: (toolId, why) => {
          followers.delete(toolId);
          post({ kind: "refused", toolId, why });
        },
      });
      break;
    case "put":
      followers.set(data.toolId, new Follower(sceneSizeM, data.goal));
      driver?.put(data.toolId, data.goal);
      break;
    case "want": {
      const follower = followers.get(data.toolId);
      if (follower) follower.goal = data.goal;
      break;
    }
    case "lift":
      followers.delete(data.toolId);
      driver?.lift(data.toolId);
      break;
    case "end":
      end();
  }
};

function end(): void {
  driver?.end();
  driver = undefined;
  followers.clear();
}

let last = performance.now();
setInterval(() => {
  const now = performance.now();
  const elapsedS = Math.min((now - last) / 1000, LONGEST_TICK_S);
  last = now;
  for (const [toolId, follower] of followers) {
    if (follower.follow(elapsedS)) driver?.move(toolId, follower.pose);
  }
}, EVERY_MS);
