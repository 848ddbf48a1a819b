// The page: one stage, one session at a time.

import "./style.css";
import { download, glb } from "./export";
import type { SessionDescription } from "./gen/kerf/v1/session_pb";
import { Input } from "./input";
import { inWords, movedTo } from "./net/errors";
import type { StreamStatus } from "./net/frames";
import { made } from "./net/making";
import { sessions, whenUnknown } from "./net/server";
import { heldToken, takeToken, withTokenBehind } from "./net/token";
import { View } from "./net/view";
import { canDraw, Stage } from "./scene/stage";
import { showsElements, type Style } from "./scene/tissue";
import { SceneText } from "./scene-text";
import { Session } from "./session";
import { Bars } from "./ui/bars";
import { byId } from "./ui/dom";
import { openHelp } from "./ui/help";
import { followLayout } from "./ui/layout";
import { say, sayBusy, stand, unsay } from "./ui/messages";
import { openPoints, savePoint } from "./ui/points";
import { Readings } from "./ui/readings";
import { openSettings } from "./ui/settings";
import { openSignIn } from "./ui/sign-in";
import { openStart } from "./ui/start";
import { followTheme } from "./ui/theme";
import { viewLink, viewOf } from "./view-link";

class App {
  private readonly stage = new Stage(byId("stage") as HTMLCanvasElement);
  private readonly readings = new Readings();
  private readonly bars: Bars;
  private readonly view: View;
  private readonly input: Input;
  private session: Session | undefined;
  /** No picture of a session was drawn yet: how long that took is measured. */
  private isFirst = true;
  /** Sessions that this page began. */
  private readonly begun = new Set<string>();
  /** The scene of the session, to begin it anew when the server has lost it. */
  private sceneToml = "";
  /** What is begun in place of the session is as private. */
  private isPrivate = false;

  constructor() {
    this.input = new Input(this.stage, () => this.session);
    this.view = new View({
      onFrame: (frame) => this.session?.show(frame) ?? [],
      onStatus: (status) => this.session?.hearStatus(status),
      onEvent: (event) => this.session?.hear(event),
      onFault: (object) => this.session?.hearFault(object),
    });
    const theme = followTheme((backdrop) => (this.stage.backdrop = backdrop));
    const ask = (act: (session: Session) => unknown) => () => {
      if (this.session) act(this.session);
    };
    this.bars = new Bars({
      chooseScene: () => this.choose(),
      changeScene: ask(({ id }) => openSettings(id, (toml) => this.change(toml))),
      share: ask(() => this.share()),
      savePicture: ask(() => this.savePicture()),
      saveModel: ask((session) => this.saveModel(session)),
      toggleTheme: theme.toggle,
      help: openHelp,
      take: (toolId) => this.session?.take(toolId),
      putAway: ask((session) => session.putAway()),
      toggleJaws: () => this.toggleJaws(),
      nudge: (away, turn) => this.input.nudge(away, turn),
      togglePause: ask((session) => session.togglePause()),
      step: ask((session) => session.step()),
      reset: ask((session) => session.reset()),
      savePoint: ask((session) => session.ask(() => savePoint(session.id))),
      openPoints: ask((session) => openPoints(session.id)),
      style: (style) => this.draw(style),
      showForces: (shown) => {
        if (this.session) this.session.picture.showsForces = shown;
      },
    });
    followLayout();
    window.addEventListener("keydown", (event) => this.key(event));
    const tick = (now: number) => {
      this.session?.tick();
      const isNew = this.view.takeFrame();
      this.stage.draw(now);
      if (isNew && this.isFirst) {
        this.isFirst = false;
        performance.mark("kerf-first-picture");
      }
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  /** The session that the address names, or else a choice. */
  async start(): Promise<void> {
    const id = new URLSearchParams(location.search).get("session");
    if (id) await this.join(id);
    else this.choose();
  }

  private choose(): void {
    const scene = async (name: string, isPrivate: boolean) => {
      try {
        const { sceneToml } = await sessions.getScene({ of: { case: "sceneName", value: name } });
        const text = new SceneText(sceneToml);
        text.addMissingTools();
        await this.begin(text.toString(), { isPrivate, fits: true });
      } catch (error) {
        stand("This scene did not start", inWords(error), [{ label: "Back", choose: () => this.choose() }]);
      }
    };
    const own = async (toml: string, uploadId: string, isPrivate: boolean) => {
      try {
        await this.begin(toml, { isPrivate, fits: true, uploadId });
      } catch (error) {
        stand("This scene did not start", inWords(error), [{ label: "Back", choose: () => this.choose() }]);
      }
    };
    void openStart({
      scene: (name, isPrivate) => void scene(name, isPrivate),
      session: (id) => void this.join(id),
      own: (toml, uploadId, isPrivate) => void own(toml, uploadId, isPrivate),
    });
  }

  /** With `fits` at a step rate that the server's machine keeps, else at the scene's own; with files that were sent. */
  private async begin(
    sceneToml: string,
    { isPrivate, fits = false, uploadId = "" }: { isPrivate: boolean; fits?: boolean; uploadId?: string },
  ): Promise<void> {
    const busy = sayBusy("The server makes the tissue…");
    try {
      const scene = { case: "sceneToml" as const, value: sceneToml };
      const request = { scene, fitStepRate: fits, uploadId, private: isPrivate };
      const session = await made(sessions.makeSession({ request }), (share, what) => busy.tell(share, what));
      this.begun.add(session.sessionId);
      await this.open(session);
    } finally {
      busy.done();
    }
  }

  private async join(sessionId: string): Promise<void> {
    try {
      const { session } = await sessions.describeSession({ sessionId });
      await this.open(session!);
    } catch (error) {
      const to = movedTo(error);
      if (to !== undefined) return this.follow(to, sessionId);
      stand("This session cannot be joined", inWords(error), [
        { label: "Choose a scene", choose: () => this.choose() },
        { label: "Try again", choose: () => void this.join(sessionId) },
      ]);
    }
  }

  private async open(description: SessionDescription): Promise<void> {
    unsay();
    this.session?.leave();
    const { sessionId, scene } = description;
    this.isPrivate = description.private;
    // The address that the page was opened with may say where to look from; another session is framed anew.
    const view = new URLSearchParams(location.search).get("session") === sessionId ? viewOf(location.search) : undefined;
    history.replaceState(null, "", viewLink(location.href, sessionId, view));
    this.bars.showScene(scene!.name, scene!.tools);
    this.session = new Session(this.stage, description, this.readings, {
      onStatus: (status) => this.showStatus(status),
      onPaused: (isPaused) => this.bars.showPaused(isPaused),
      onFailed: (why) => this.sayFailed(why),
      onTool: (toolId) => {
        this.bars.showTool(toolId);
        this.bars.showJaws(this.session?.hand?.jawsAreOpen ?? true);
        this.input.suit(toolId !== undefined);
      },
    });
    if (view) this.stage.look(view);
    this.input.suit(false);
    this.view.open(sessionId);
    this.draw(this.bars.style);
    this.session.picture.showsForces = this.bars.showsForces;
    this.sceneToml = (await sessions.getScene({ of: { case: "sessionId", value: sessionId } })).sceneToml;
  }

  /** The same scene with other numbers, in place of a session that nobody else looks at. */
  private async change(toml: string): Promise<void> {
    const before = this.session?.id;
    this.readings.keepForComparison();
    await this.begin(toml, { isPrivate: this.isPrivate });
    if (before === undefined || !this.begun.has(before)) return;
    const { session } = await sessions.describeSession({ sessionId: before });
    if ((session?.viewers ?? 0) <= 1) await sessions.closeSession({ sessionId: before });
  }

  private showStatus(status: StreamStatus): void {
    this.bars.showStatus(status);
    if (status.phase === "live") unsay();
    if (status.phase === "moved" && this.session) this.follow(status.to, this.session.id, this.stage.viewPoint);
    if (status.phase !== "ended") return;
    const again = () => this.begin(this.sceneToml, { isPrivate: this.isPrivate });
    stand("This session is over", status.message, [
      ...(this.sceneToml === "" ? [] : [{ label: "Begin it again", choose: () => void again().catch(sayError) }]),
      { label: "Choose a scene", choose: () => this.choose() },
    ]);
  }

  /** Goes on where a session has moved to: on the page of that server, with the same view. */
  private follow(to: string, sessionId: string, view = viewOf(location.search)): void {
    const [address, token] = [viewLink(new URL("/", to).href, sessionId, view), heldToken()];
    location.assign(token === undefined ? address : withTokenBehind(address, token));
  }

  private sayFailed(why: string): void {
    const text = `The simulation stopped: ${why}. Put the tissue back to rest to go on.`;
    stand("A step failed", text, [{ label: "Back to rest", choose: () => void this.session?.reset() }]);
  }

  private draw(style: Style): void {
    this.view.want({ nodes: showsElements(style), adaptation: style !== "unadapted" });
    if (this.session) this.session.style = style;
  }

  private toggleJaws(): void {
    const hand = this.session?.hand;
    if (!hand) return;
    hand.jawsAreOpen = !hand.jawsAreOpen;
    this.bars.showJaws(hand.jawsAreOpen);
  }

  private async share(): Promise<void> {
    if (this.session) history.replaceState(null, "", viewLink(location.href, this.session.id, this.stage.viewPoint));
    const { link, words } = await this.linkToShare();
    try {
      await navigator.clipboard.writeText(link);
      say(`The link is copied. ${words}`);
    } catch {
      // Pages that did not come over https or from this machine may not copy.
      say(`Copy this to let somebody join: ${link}`);
    }
  }

  /** The page's address. Where tokens are asked for, it brings one that shows the session and does nothing else. */
  private async linkToShare(): Promise<{ link: string; words: string }> {
    const link = location.href;
    if (heldToken() === undefined || !this.session) {
      return { link, words: "Whoever opens it joins this session and sees what you see." };
    }
    try {
      const { token, goodForS } = await sessions.inviteViewer({ sessionId: this.session.id });
      const hours = Math.max(1, Math.round(goodForS / 3600));
      return { link: withTokenBehind(link, token), words: `For ${hours} h whoever opens it sees this session, and cannot touch it.` };
    } catch {
      // Viewers invite nobody.
      return { link, words: "Whoever opens it needs a token of their own." };
    }
  }

  private async savePicture(): Promise<void> {
    const blob = await this.stage.picture();
    if (blob) download(blob, "kerf.png");
  }

  private async saveModel(session: Session): Promise<void> {
    download(await glb(session.picture.exported), "kerf.glb");
  }

  private key(event: KeyboardEvent): void {
    const isTyping = event.target instanceof Element && event.target.closest("input, textarea, select, dialog");
    if (isTyping || event.ctrlKey || event.metaKey) return;
    const { session } = this;
    const isButton = event.target instanceof HTMLButtonElement;
    const keys: Record<string, () => unknown> = {
      ".": () => session?.step(),
      r: () => session?.reset(),
      s: () => session?.ask(() => savePoint(session.id)),
      b: () => session && openPoints(session.id),
      c: () => this.toggleJaws(),
      v: () => this.bars.nextStyle(),
      f: () => this.bars.toggleForces(),
      p: () => this.savePicture(),
      "?": openHelp,
      Escape: () => session?.putAway(),
      // On a button it presses the button.
      ...(isButton ? {} : { " ": () => session?.togglePause() }),
    };
    const act = keys[event.key] ?? keys[event.key.toLowerCase()];
    if (act) void act();
    else if (/^[1-9]$/.test(event.key)) session?.take(Number(event.key) - 1);
    else if (!this.input.key(event)) return;
    event.preventDefault();
  }
}

function sayError(error: unknown): void {
  say(inWords(error), "problem");
}

takeToken();
whenUnknown(openSignIn);
if (canDraw()) {
  void new App().start();
} else {
  stand(
    "This browser cannot draw the tissue",
    "WebGL 2 is missing or switched off. Switch on hardware acceleration in the browser's settings, or open this " +
      "page in a current Chrome, Edge, Firefox or Safari.",
    [{ label: "Try again", choose: () => location.reload() }],
  );
}
