// What the page has to say in passing, and what stands until it is dealt with.

import { byId, element, textButton } from "./dom";

const SHOWN_MS = 6000;
/** More than these at a time nobody reads. */
const MOST_SHOWN = 3;

/** Something in passing. */
export function say(text: string, kind: "note" | "problem" = "note"): void {
  const message = element("p", { className: `message ${kind}`, textContent: text });
  const messages = byId("messages");
  messages.append(message);
  while (messages.childElementCount > MOST_SHOWN) messages.firstElementChild!.remove();
  setTimeout(() => message.remove(), SHOWN_MS);
}

/** Something that takes its time: stands, with the seconds that have gone, until the answer is called. */
export function sayUntil(text: string): () => void {
  const begun = performance.now();
  const message = element("p", { className: "message busy", textContent: text });
  byId("messages").append(message);
  const timer = setInterval(() => {
    message.textContent = `${text} ${Math.round((performance.now() - begun) / 1000)} s`;
  }, 1000);
  return () => {
    clearInterval(timer);
    message.remove();
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
