// What the page has to say in passing, and what stands until it is dealt with.

import { byId, element, textButton } from "./dom";

/** How long something in passing stands, ms. */
export const SHOWN_MS = 6000;
/** More than these at a time nobody reads. */
const MOST_SHOWN = 3;

/** Something in passing. What is said of a topic takes the place of what was said of it before. */
export function say(text: string, kind: "note" | "problem" = "note", topic = text): void {
  const messages = byId("messages");
  const before = [...messages.children].find((shown) => shown instanceof HTMLElement && shown.dataset["topic"] === topic);
  before?.remove();
  const message = element("p", { className: `message ${kind}`, textContent: text });
  message.dataset["topic"] = topic;
  messages.append(message);
  while (messages.childElementCount > MOST_SHOWN) messages.firstElementChild!.remove();
  setTimeout(() => message.remove(), SHOWN_MS);
}

/** Something that takes its time, and tells how far it is. */
export interface Busy {
  /** How far, 0 to 1, and with what. */
  tell(share: number, text: string): void;
  done(): void;
}

/** Stands, with the seconds that have gone, until it is done. */
export function sayBusy(text: string): Busy {
  const begun = performance.now();
  const said = element("span", { textContent: text });
  const bar = element("progress", { max: 1, aria: { label: "Progress" } });
  const message = element("p", { className: "message busy" }, said, bar);
  byId("messages").append(message);
  const show = () => {
    const seconds = Math.round((performance.now() - begun) / 1000);
    said.textContent = seconds > 0 ? `${text} ${seconds} s` : text;
  };
  const timer = setInterval(show, 1000);
  return {
    tell: (share, next) => {
      bar.value = share;
      text = next;
      show();
    },
    done: () => {
      clearInterval(timer);
      message.remove();
    },
  };
}

export interface Choice {
  label: string;
  choose: () => void;
}

let standing: HTMLElement | undefined;

/** Something that stands in the middle of the page until a choice is made, or `unsay` is called. */
export function stand(title: string, text: string, choices: readonly Choice[]): void {
  unsay();
  const buttons = choices.map(({ label, choose }, i) =>
    textButton(label, () => (unsay(), choose()), i === 0 ? "primary" : ""),
  );
  standing = element(
    "section",
    { className: "standing panel", aria: { role: "alert" } },
    element("h2", { textContent: title }),
    element("p", { textContent: text }),
    element("div", { className: "row" }, ...buttons),
  );
  document.body.append(standing);
  buttons[0]?.focus();
}

export function unsay(): void {
  standing?.remove();
  standing = undefined;
}
