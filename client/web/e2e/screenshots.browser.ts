// Draws the README's pictures of the viewer.

import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, test } from "vitest";
import { freePort, launch, live, open, reading, readingWhere, Server } from "./harness";

const SIZE = { width: 1280, height: 800 };
/** Without a graphics card a picture takes seconds. */
const PATIENCE_MS = 400_000;

let browser: Browser;
let server: Server;

beforeAll(async () => {
  server = new Server(await freePort());
  await server.start();
  browser = await launch();
});

afterAll(async () => {
  await browser?.close();
  await server?.stop();
});

/** A session of a built-in scene at a rate that a busy machine keeps. */
async function watch(name: string): Promise<Page> {
  const { session } = await server.sessions.createSession({
    scene: { case: "sceneName", value: name },
    stepRateHz: 125,
  });
  const { page } = await open(browser, `${server.address}/?session=${session!.sessionId}`, SIZE);
  await live(page);
  await readingWhere(page, "Time", (timeS) => timeS > 0.5);
  return page;
}

/** Drags from a point of the page by some pixels, until it holds. */
async function drag(page: Page, from: [number, number], by: [number, number], until: () => Promise<boolean>) {
  const steps = 40;
  await page.mouse.move(...from);
  await page.mouse.down();
  for (let i = 1; i <= steps && !(await until()); i++) {
    await page.mouse.move(from[0] + (by[0] * i) / steps, from[1] + (by[1] * i) / steps);
    await page.waitForTimeout(150);
  }
  await page.mouse.up();
}

const never = () => Promise.resolve(false);

/** The session stands, so the picture is drawn as fine as the screen. */
async function shoot(page: Page, name: string): Promise<void> {
  await page.keyboard.press(" ");
  await page.waitForSelector("button[aria-label='Go on']");
  await page.mouse.move(5, 795);
  await page.waitForTimeout(6000);
  await page.screenshot({ path: `../../docs/${name}`, type: "jpeg", quality: 88 });
  await page.close();
}

test("a liver under the blade", { timeout: PATIENCE_MS }, async () => {
  const page = await watch("liver");
  await page.click("button:has-text('Blade')");
  await drag(page, [520, 200], [0, 190], async () => (await reading(page, "Cut area")) > 24);
  // Out again, so that the cut is seen that the tension holds open.
  await drag(page, [520, 380], [0, -90], never);
  await shoot(page, "viewer-liver.jpg");
});

test("a gummy bear, cut open", { timeout: PATIENCE_MS }, async () => {
  const page = await watch("gummy-bear");
  await page.click("button:has-text('Blade')");
  await drag(page, [520, 200], [0, 300], async () => (await reading(page, "Cut area")) > 9);
  await drag(page, [520, 400], [60, -60], never);
  await shoot(page, "viewer-bear.jpg");
});

test("every built-in scene, for the choice of scenes", { timeout: 4 * PATIENCE_MS }, async () => {
  const { scenes } = await server.sessions.listScenes({});
  for (const { name } of scenes) {
    const { session } = await server.sessions.createSession({
      scene: { case: "sceneName", value: name },
      stepRateHz: 125,
      startPaused: true,
    });
    const { sessionId } = session!;
    await server.sessions.stepSession({ sessionId, steps: 30 });
    const { page } = await open(browser, `${server.address}/?session=${sessionId}`, { width: 640, height: 360 });
    await live(page);
    // Bars and readings are not of the scene.
    await page.addStyleTag({ content: "body > :not(#stage) { display: none !important; }" });
    await page.waitForTimeout(4000);
    await page.screenshot({ path: `public/scene-${name}.jpg`, type: "jpeg", quality: 72 });
    await page.close();
    await server.sessions.closeSession({ sessionId });
  }
});
