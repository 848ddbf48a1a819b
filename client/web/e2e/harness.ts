// A server, a browser and pages in it. The browser draws without a graphics card, slowly, so windows are small.

import { type ChildProcess, spawn, spawnSync } from "node:child_process";
import { once } from "node:events";
import { mkdtemp, rm } from "node:fs/promises";
import { type AddressInfo, connect, createServer } from "node:net";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createClient } from "@connectrpc/connect";
import { createGrpcWebTransport } from "@connectrpc/connect-web";
import { type Browser, chromium, type JSHandle, type Page } from "playwright-core";
import { afterAll, beforeAll } from "vitest";
import { SessionService } from "../src/gen/kerf/v1/session_pb";

const BINARY = process.env["SERVER_BINARY"] ?? "../../target/debug/kerf-server";
const CHROMIUM = process.env["CHROMIUM"] ?? "/usr/bin/chromium";
const FLAGS = [
  "--no-sandbox",
  "--disable-quic",
  "--no-first-run",
  "--disable-background-networking",
  "--disable-component-update",
  "--disable-sync",
  "--use-gl=angle",
  "--use-angle=swiftshader",
  "--enable-unsafe-swiftshader",
];

/** A bar held by its left end, that the page's blade goes through. */
export const BAR = `
version = 1
name = "bar"
description = "A bar that is held by one end."
rate_hz = 250.0
[[objects]]
name = "bar"
shape = { box = { min_m = [-0.03, 0.0, -0.01], max_m = [0.03, 0.02, 0.01] } }
resolution = 18
level = 1
material = { young_modulus_pa = 3.0e4, poisson_ratio = 0.4, fracture_energy_j_per_m2 = 5.0, strain_stiffening = 10.0, rayleigh_alpha_per_s = 5.0 }
fixed = [{ box = { min_m = [-1.0, -1.0, -1.0], max_m = [-0.02, 1.0, 1.0] } }]
[[tools]]
name = "blade"
shape = { blade = { width_m = 0.05, height_m = 0.04 } }
[[tools]]
name = "grasper"
shape = { grasper = { radius_m = 0.004 } }
`;

export async function freePort(): Promise<number> {
  const probe = createServer().listen(0, "127.0.0.1");
  await once(probe, "listening");
  const { port } = probe.address() as AddressInfo;
  probe.close();
  return port;
}

/** A bar of apple, drawn apart by its ends, so that a cut across it stands open. */
export const APPLE = BAR.replaceAll('"bar"', '"apple"').replace(
  "fixed = [",
  `loads = [{ traction = { region = { box = { min_m = [-1.0, -1.0, -1.0], max_m = [1.0, 1.0, 1.0] } }, face = "max_x", traction_pa = [2.0e3, 0.0, 0.0] } }]
fixed = [`,
);

/** A server on a port of its own. */
export class Server {
  readonly port: number;
  private process: ChildProcess | undefined;
  private readonly settings: string[];

  constructor(port: number, settings: string[] = []) {
    this.port = port;
    this.settings = settings;
  }

  get address(): string {
    return `http://127.0.0.1:${this.port}`;
  }

  get sessions() {
    return createClient(SessionService, createGrpcWebTransport({ baseUrl: this.address }));
  }

  async start(): Promise<void> {
    // A browser that draws without a graphics card may be busy for longer than a hand holds still.
    const settings = ["session.lease_s=30", ...this.settings].flatMap((setting) => ["--set", setting]);
    const args = ["serve", "--listen", `127.0.0.1:${this.port}`, "--log-filter", "error", ...settings];
    this.process = spawn(BINARY, args, { stdio: ["ignore", "inherit", "inherit"] });
    for (;;) {
      try {
        await this.sessions.listSessions({});
        return;
      } catch {
        if (this.process.exitCode !== null) throw new Error(`${BINARY} ended with ${this.process.exitCode}`);
        await new Promise((resolve) => setTimeout(resolve, 50));
      }
    }
  }

  /** The text of a built-in scene. */
  async textOf(name: string): Promise<string> {
    return (await this.sessions.getScene({ of: { case: "sceneName", value: name } })).sceneToml;
  }

  async create(sceneToml: string): Promise<string> {
    const { session } = await this.sessions.createSession({ scene: { case: "sceneToml", value: sceneToml } });
    return session!.sessionId;
  }

  async stop(): Promise<void> {
    const { process } = this;
    if (!process || process.exitCode !== null) return;
    const ended = once(process, "exit");
    process.kill("SIGKILL");
    await ended;
  }
}

/** A server with TLS that asks for tokens. */
export interface Secured {
  /** That it shows at its first start: an operator's. */
  link: URL;
  /** A link with a token that the command makes. */
  linkOf: (name: string, role: string) => Promise<URL>;
  stop: () => Promise<void>;
}

export async function startSecured(): Promise<Secured> {
  const folder = await mkdtemp(join(tmpdir(), "kerf-"));
  const listen = `127.0.0.1:${await freePort()}`;
  const args = ["serve", "--listen", listen, "--log-filter", "error", "--security-dir", folder];
  const process = spawn(BINARY, args, { stdio: ["ignore", "pipe", "inherit"] });
  let shown = "";
  for await (const part of process.stdout) {
    shown += String(part);
    const link = /https:\S+#token=\S+/.exec(shown)?.[0];
    if (!link) continue;
    const stop = async () => {
      const ended = once(process, "exit");
      process.kill("SIGKILL");
      await ended;
      await rm(folder, { recursive: true });
    };
    const linkOf = async (name: string, role: string) => {
      const file = join(folder, "tokens.toml");
      const made = spawnSync(BINARY, ["token", "new", "--name", name, "--role", role, "--file", file], { encoding: "utf8" });
      const token = /[\w-]{43}/.exec(made.stdout)?.[0];
      if (!token) throw new Error(`token new: ${made.stderr}`);
      // The server reads the file again within a second.
      await new Promise((resolve) => setTimeout(resolve, 1500));
      return Object.assign(new URL(link), { hash: `token=${token}` });
    };
    return { link: new URL(link), linkOf, stop };
  }
  throw new Error(`${BINARY} ended and showed no link: ${shown}`);
}

/** The sessions that whoever has a link sees, whose server shows a certificate of its own. */
export async function seenBy(link: URL): Promise<string[]> {
  const transport = createGrpcWebTransport({
    baseUrl: link.origin,
    interceptors: [
      (next) => (request) => {
        request.header.set("authorization", `Bearer ${link.hash.replace("#token=", "")}`);
        return next(request);
      },
    ],
  });
  process.env["NODE_TLS_REJECT_UNAUTHORIZED"] = "0";
  try {
    const { sessions } = await createClient(SessionService, transport).listSessions({});
    return sessions.map(({ sessionId }) => sessionId);
  } finally {
    delete process.env["NODE_TLS_REJECT_UNAUTHORIZED"];
  }
}

/** A port that lets only so many bytes a second through to another. */
export async function slowLink(to: number, bytesPerSecond: number): Promise<{ address: string; close: () => void }> {
  const tickMs = 50;
  const server = createServer((client) => {
    const upstream = connect(to, "127.0.0.1");
    client.pipe(upstream);
    const timer = setInterval(() => {
      const waiting = upstream.readableLength;
      const share = Math.min(waiting, Math.ceil((bytesPerSecond * tickMs) / 1000));
      if (share > 0) client.write(upstream.read(share) as Buffer);
    }, tickMs);
    const end = () => {
      clearInterval(timer);
      client.destroy();
      upstream.destroy();
    };
    for (const socket of [client, upstream]) socket.on("error", end).on("close", end);
  }).listen(0, "127.0.0.1");
  await once(server, "listening");
  const { port } = server.address() as AddressInfo;
  return { address: `http://127.0.0.1:${port}`, close: () => server.close() };
}

/** The browser and the server of a file of tests, while it runs: see `useBrowserAndServer`. */
export let browser: Browser;
export let server: Server;

/** Starts a server and a browser before a file's tests, and ends both after them. */
export function useBrowserAndServer(): void {
  beforeAll(async () => {
    server = new Server(await freePort());
    await server.start();
    browser = await chromium.launch({ executablePath: CHROMIUM, args: FLAGS });
  });
  afterAll(async () => {
    await browser?.close();
    await server?.stop();
  });
}

/** What a page is opened with. */
interface Opened {
  width: number;
  height: number;
  /** Pixels that are drawn for one of the page, along a side. */
  deviceScaleFactor?: number;
  colorScheme?: "dark" | "light";
  hasTouch?: boolean;
}

/** A small window, drawn coarsely. */
const SMALL: Opened = { width: 800, height: 560, deviceScaleFactor: 0.5 };

/** Opens a page; what goes wrong in it is kept. */
export async function open(browser: Browser, url: string, how = SMALL) {
  const { width, height, deviceScaleFactor = 1, colorScheme = "dark", hasTouch = false } = how;
  // A server's own certificate is one that no browser knows.
  const viewport = { width, height };
  const page = await browser.newPage({ viewport, deviceScaleFactor, colorScheme, hasTouch, ignoreHTTPSErrors: true });
  const problems: string[] = [];
  page.on("pageerror", (error) => problems.push(error.message));
  page.on("console", (message) => {
    if (message.type() === "error") problems.push(message.text());
  });
  // Another page that draws without a graphics card holds it up.
  await page.goto(url, { timeout: 90_000 });
  return { page, problems };
}

export async function live(page: Page): Promise<void> {
  await page.waitForSelector('.connection[data-phase="live"]');
}

/** What an instrument of the page says. */
export async function reading(page: Page, name: string): Promise<number> {
  const text = await page.textContent(`output[data-reading="${name}"]`);
  return Number.parseFloat(text ?? "");
}

export async function readingWhere(page: Page, name: string, holds: (value: number) => boolean): Promise<number> {
  for (;;) {
    const value = await reading(page, name);
    if (holds(value)) return value;
    await page.waitForTimeout(100);
  }
}

/** An energy that an instrument says, J. */
export async function joules(page: Page, name: string): Promise<number> {
  const text = (await page.textContent(`output[data-reading="${name}"]`)) ?? "";
  const [value, unit] = text.split(" ");
  return Number(value) * ({ "µJ": 1e-6, mJ: 1e-3, J: 1 }[unit] ?? Number.NaN);
}

/** Share of the canvas's pixels that are redder than they are green and blue: tissue. */
export function redShare(page: Page): Promise<number> {
  return share(page, "red");
}

/** Share of the canvas's pixels that are as bright in red as in green: the flesh of an apple, not its skin. */
export function paleShare(page: Page): Promise<number> {
  return share(page, "pale");
}

async function share(page: Page, color: "red" | "pale"): Promise<number> {
  const picture = await pixels(page, await page.locator("#stage").screenshot());
  return page.evaluate(([data, color]) => {
    let count = 0;
    for (let i = 0; i < data.length; i += 4) {
      const [r, g, b] = data.subarray(i, i + 3);
      const isRed = r > 40 && r > 1.5 * g && r > 1.5 * b;
      const isPale = r > 110 && g > 0.8 * r && b < 0.95 * g;
      if (color === "red" ? isRed : isPale) count += 1;
    }
    return count / (data.length / 4);
  }, [picture, color] as const);
}

/** Share of the canvas's pixels that are darker by a third than they were in an earlier picture of it. */
export async function darkenedShare(page: Page, before: Buffer): Promise<number> {
  const after = await page.locator("#stage").screenshot();
  return page.evaluate(([one, other]) => {
    let count = 0;
    for (let i = 0; i < one.length; i += 4) {
      const [was, is] = [one, other].map((data) => data[i] + data[i + 1] + data[i + 2]);
      if (was > 60 && is < 0.67 * was) count += 1;
    }
    return count / (one.length / 4);
  }, [await pixels(page, before), await pixels(page, after)] as const);
}

/** Red, green, blue and alpha of a picture's pixels, in the page, which can decode it. */
function pixels(page: Page, png: Buffer): Promise<JSHandle<Uint8ClampedArray>> {
  return page.evaluateHandle(async (base64) => {
    const image = new Image();
    image.src = `data:image/png;base64,${base64}`;
    await image.decode();
    const canvas = Object.assign(document.createElement("canvas"), { width: image.width, height: image.height });
    const context = canvas.getContext("2d")!;
    context.drawImage(image, 0, 0);
    return context.getImageData(0, 0, image.width, image.height).data;
  }, png.toString("base64"));
}
