// Puts messages together that were too large for one.

import { fromBinary } from "@bufbuild/protobuf";
import { type ViewResponse, ViewResponseSchema } from "../gen/kerf/v1/view_pb";
import { ReplicaError } from "./check";

/** What a whole message may hold, bytes: the largest that the server sends. */
const MAX_BYTES = 64 * 1024 * 1024;

/** Collects the fragments of a view stream. */
export class Assembler {
  private parts: Uint8Array[] = [];
  private bytes = 0;
  /** Fragments that are still to come. */
  private remaining = 0;

  /** Takes the stream's next event; answers with one that is whole, once there is one. */
  take(event: ViewResponse): ViewResponse | undefined {
    if (event.message.case !== "fragment") {
      if (this.remaining > 0) throw this.fail();
      return event;
    }
    const { data, remaining } = event.message.value;
    const follows = this.remaining === 0 || remaining + 1 === this.remaining;
    this.bytes += data.length;
    if (!follows || this.bytes > MAX_BYTES) throw this.fail();
    this.parts.push(data);
    this.remaining = remaining;
    return remaining > 0 ? undefined : this.whole();
  }

  private whole(): ViewResponse {
    const data = new Uint8Array(this.bytes);
    let at = 0;
    for (const part of this.parts) {
      data.set(part, at);
      at += part.length;
    }
    this.clear();
    try {
      return fromBinary(ViewResponseSchema, data);
    } catch (error) {
      throw new ReplicaError(`fragments that do not make a message: ${String(error)}`, true);
    }
  }

  private fail(): ReplicaError {
    this.clear();
    return new ReplicaError("fragments of a message are missing", true);
  }

  private clear(): void {
    this.parts = [];
    this.bytes = 0;
    this.remaining = 0;
  }
}
