// Draws the README's pictures of the viewer.

import { mkdir, readFile, rm, writeFile } from "node:fs/promises";
import type { Page } from "playwright-core";
import { Quaternion } from "three";
import { test } from "vitest";
import { ACROSS, LockStep } from "./gallery/lockstep";
import { Window } from "./gallery/sheet";
import { browser, live, open, reading, readingWhere, server, useBrowserAndServer } from "./harness";

const SIZE = { width: 1280, height: 800 };
/** Without a graphics card a picture takes seconds. */
const PATIENCE_MS = 400_000;

useBrowserAndServer();

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
  await page.screenshot({ path: `../../docs/images/${name}`, type: "jpeg", quality: 88 });
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

/** Frames of the moving picture, which `animate.py` puts together. */
const FRAMES = "../../out/cut";

test("a liver, cut and opened, picture by picture", { timeout: 2 * PATIENCE_MS }, async () => {
  await rm(FRAMES, { recursive: true, force: true });
  await mkdir(FRAMES, { recursive: true });
  const session = await LockStep.begin(server, { name: "liver", stepRateHz: 250 });
  const look = { eye: [0.11, 0.23, 0.33], at: [0.0, 0.1, 0] } as const;
  const window = await Window.open(browser, server.address, session, look);
  let frames = 0;
  const move = async (y: number, pictures: number) => {
    const from = edgeM;
    for (let i = 1; i <= pictures; i++) {
      edgeM = from + ((y - from) * i) / pictures;
      await session.go({ tool: "blade", to: { at: [0, edgeM, 0.02], turn: ACROSS }, seconds: 0.04 });
      await writeFile(`${FRAMES}/${String(frames++).padStart(3, "0")}.png`, await window.shoot());
    }
  };
  let edgeM = 0.165;
  await session.go({ tool: "blade", to: { at: [0, edgeM, 0.02], turn: ACROSS } });
  await move(0.085, 28);
  await move(0.165, 14);
  await window.close();
  await session.end();
});

test("the tutorial's block, with the blade in its second cut", { timeout: PATIENCE_MS }, async () => {
  const tutorial = await readFile("../../docs/tutorial/README.md", "utf8");
  const first = (language: string) => tutorial.match(new RegExp(`\`\`\`${language}\\n(.*?)\`\`\``, "s"))![1];
  const session = await LockStep.begin(server, { text: first("toml") });
  const look = { eye: [0.065, 0.09, 0.12], at: [0, 0.026, 0] } as const;
  const window = await Window.open(browser, server.address, session, look);
  let beforeS = 0;
  for (const line of first("csv").trim().split("\n").slice(1)) {
    const [time, tool, ...place] = line.split(",");
    const [x, y, z, ...turn] = place.map(Number);
    const to = place[0] === "lift" ? "lift" : { at: [x, y, z] as const, turn: new Quaternion(...turn) };
    await session.go({ tool, to, seconds: Number(time) - beforeS });
    beforeS = Number(time);
    if (beforeS === 2.3) break;
  }
  await writeFile("../../docs/images/tutorial-slices.png", await window.shoot());
  await window.close();
  await session.end();
});

/** Blocks that nothing but the edge of their blade tells apart, which goes some way into them. */
async function cutBlock(session: LockStep): Promise<void> {
  await session.go({ tool: "blade", to: { at: [0, 0.0701, 0] } });
  await session.go({ tool: "blade", to: { at: [0, 0.05, 0] }, seconds: 0.4 });
}

test("every built-in scene, for the choice of scenes", { timeout: 4 * PATIENCE_MS }, async () => {
  const { scenes } = await server.sessions.listScenes({});
  for (const { name } of scenes) {
    const session = await LockStep.begin(server, { name, stepRateHz: 125 });
    await session.wait(0.24);
    if (name.startsWith("cuboid")) await cutBlock(session);
    const { page } = await open(browser, `${server.address}/?session=${session.sessionId}`, { width: 640, height: 360 });
    await live(page);
    await page.keyboard.press("f");
    // Bars and readings are not of the scene.
    await page.addStyleTag({ content: "body > :not(#stage) { display: none !important; }" });
    await page.waitForTimeout(4000);
    await page.screenshot({ path: `public/scene-${name}.jpg`, type: "jpeg", quality: 72 });
    await page.close();
    await session.end();
  }
});
