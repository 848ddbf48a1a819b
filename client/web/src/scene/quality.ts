// How fine the picture is: as fine as the screen while the machine draws it in time, coarser where it does not.

/** Time that a picture may take on average, ms: twenty a second still look like motion. */
const SLOW_MS = 50;
/** Pictures that are judged at a time. */
const JUDGED = 6;
/** After this long without a change a picture is drawn as fine as the screen, ms. */
const STILL_MS = 400;
/** Pixels that are drawn for one of the screen, along a side. */
const FINENESS = [1, 0.75, 0.5, 0.35];

export class Quality {
  private level = 0;
  private times: number[] = [];
  private lastMs = Number.NEGATIVE_INFINITY;
  private isFine = true;

  /** Another scene may be lighter. */
  restart(): void {
    this.level = 0;
    this.times = [];
  }

  /** Share of the screen's fineness that a moving picture is drawn with; `now` in ms. */
  moving(now: number): number {
    const tookMs = now - this.lastMs;
    this.lastMs = now;
    this.isFine = this.level === 0;
    // What stood still before says nothing of how long a picture takes.
    if (tookMs < STILL_MS) this.times.push(tookMs);
    const sumMs = this.times.reduce((sum, time) => sum + time, 0);
    // So slow that those that are still to come cannot help it.
    const isSlow = sumMs > JUDGED * SLOW_MS;
    if (isSlow && this.level + 1 < FINENESS.length) this.level += 1;
    if (isSlow || this.times.length === JUDGED) this.times = [];
    return FINENESS[this.level];
  }

  /** Whether it is time to draw what stands still as fine as the screen. */
  standsStill(now: number): boolean {
    if (this.isFine || now - this.lastMs < STILL_MS) return false;
    this.isFine = true;
    return true;
  }
}
