// A session looked at through the viewer, and pictures of it set side by side.

import { readFile, stat } from "node:fs/promises";
import type { Browser, Page } from "playwright-core";
import { live, open } from "../harness";
import type { LockStep } from "./lockstep";

/** Size of one picture on a sheet, pixels. */
const PANEL = { width: 460, height: 360 };
/** No picture of the documents is larger, bytes. */
const MOST_BYTES = 195_000;

type Place = readonly [number, number, number];

/** Where one looks from, and at what, m. */
export interface Look {
  eye: Place;
  at: Place;
}

/** The viewer's page of a session, as wide as a picture. */
export class Window {
  private readonly page: Page;
  private readonly session: LockStep;

  private constructor(page: Page, session: LockStep) {
    this.page = page;
    this.session = session;
  }

  static async open(browser: Browser, address: string, session: LockStep, look: Look): Promise<Window> {
    const view = [...look.eye, ...look.at].join(",");
    const { page } = await open(browser, `${address}/?session=${session.sessionId}&view=${view}`, PANEL);
    await live(page);
    return new Window(page, session);
  }

  /** The picture that the key P saves, once the page has the session's last step. */
  async shoot(style = "tissue"): Promise<Buffer> {
    const { page } = this;
    await page.selectOption("select[aria-label='What is drawn']", style);
    // What is beneath the surface is asked for; a frame with the elements comes with the next state.
    if (style !== "tissue") await page.waitForTimeout(1500);
    await page.waitForFunction(
      (step) => document.querySelector<HTMLElement>("[data-reading='Time']")?.title === `Step ${step}`,
      this.session.step,
    );
    const [download] = await Promise.all([page.waitForEvent("download"), page.keyboard.press("p")]);
    // Ten thousands of voxels would be drawn all the way to the next picture.
    await page.selectOption("select[aria-label='What is drawn']", "tissue");
    return readFile(await download.path());
  }

  /** Draws no forces from now on: an arrow would hide what is looked at closely. */
  hideForces(): Promise<void> {
    return this.page.keyboard.press("f");
  }

  /** What the last colour of the elastic energy stands for. */
  async legend(): Promise<string> {
    return (await this.page.textContent("#legend output")) ?? "";
  }

  close(): Promise<void> {
    return this.page.close();
  }
}

export interface Panel {
  picture: Buffer;
  label: string;
}

/** Panels of one row, and what the row is of. */
export interface Row {
  title?: string;
  panels: readonly Panel[];
}

/** Writes rows of panels, and a drawing below them, as one picture. */
export async function writeSheet(browser: Browser, path: string, rows: readonly Row[], below = ""): Promise<void> {
  const columns = Math.max(...rows.map(({ panels }) => panels.length));
  const page = await browser.newPage({ viewport: { width: Math.max(900, 400 * columns), height: 100 } });
  await page.setContent(html(rows, columns, below));
  await page.evaluate(() => Promise.all(Array.from(document.images, (image) => image.decode())));
  for (let quality = 88; ; quality -= 6) {
    await page.locator("body").screenshot({ path, type: "jpeg", quality });
    if ((await stat(path)).size <= MOST_BYTES || quality < 40) break;
  }
  await page.close();
}

function html(rows: readonly Row[], columns: number, below: string): string {
  const panel = ({ picture, label }: Panel) =>
    `<figure><img src="data:image/png;base64,${picture.toString("base64")}"><figcaption>${label}</figcaption></figure>`;
  const row = ({ title, panels }: Row) => `${title ? `<h2>${title}</h2>` : ""}${panels.map(panel).join("")}`;
  return `<!doctype html><style>
    body { margin: 0; padding: 14px; background: #14171c; color: #e8ebf0; font: 17px Inter, "Segoe UI", sans-serif;
      display: grid; grid-template-columns: repeat(${columns}, 1fr); gap: 10px; }
    h2 { grid-column: 1 / -1; margin: 6px 2px 0; font-size: 19px; font-weight: 600; }
    figure { margin: 0; } img { display: block; width: 100%; border-radius: 8px; }
    figcaption { padding: 5px 3px 2px; color: #b8c1cd; } svg { grid-column: 1 / -1; width: 100%; }
  </style>${rows.map(row).join("")}${below}`;
}
