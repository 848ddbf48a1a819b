// Tells the server what a viewer has read: it sends no more than what is on its way may be.

import type { Client } from "@connectrpc/connect";
import type { ViewService } from "../gen/kerf/v1/view_pb";

/** One call is under way at a time; the newest number goes out with the next. */
export class Acknowledger {
  private readonly client: Client<typeof ViewService>;
  private readonly viewer: string;
  private newest = 0n;
  private told = 0n;
  private isBusy = false;

  constructor(client: Client<typeof ViewService>, viewer: string) {
    this.client = client;
    this.viewer = viewer;
  }

  /** A message was read. Events and faults have no number and are not acknowledged. */
  read(number: bigint): void {
    if (number > this.newest) this.newest = number;
    if (!this.isBusy) void this.tell();
  }

  private async tell(): Promise<void> {
    this.isBusy = true;
    try {
      while (this.told < this.newest) {
        const number = this.newest;
        await this.client.acknowledge({ viewer: this.viewer, number }, { timeoutMs: 5000 });
        this.told = number;
      }
    } catch {
      // The stream has ended, or is about to: whoever reads it hears of it there. The next message tries again.
    }
    this.isBusy = false;
  }
}
