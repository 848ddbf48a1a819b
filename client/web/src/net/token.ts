// The token that the server lets this page in by. It comes with the address, behind the `#`, which is sent to no server
// and stands in no log; it is taken out there, and kept as long as the tab is open. Workers are told it.

import type { Interceptor } from "@connectrpc/connect";

const KEY = "kerf-token";

let held: string | undefined;

export function heldToken(): string | undefined {
  return held;
}

/** From now on calls say this token. */
export function sayToken(token: string | undefined): void {
  held = token;
}

/** Keeps a token while the tab is open. */
export function keepToken(token: string): void {
  sessionStorage.setItem(KEY, token);
  held = token;
}

/** Takes the token that the page was opened with, or else the one that it was given before. */
export function takeToken(): void {
  const { href, hash } = location;
  const behind = new URLSearchParams(hash.slice(1));
  const given = behind.get("token");
  if (given !== null) {
    history.replaceState(null, "", href.slice(0, href.indexOf("#")));
    if (isToken(given)) keepToken(given);
  }
  held = sessionStorage.getItem(KEY) ?? undefined;
}

/** An address that brings a token along. */
export function withTokenBehind(address: string, token: string): string {
  return `${address}#token=${encodeURIComponent(token)}`;
}

/** Whether a text can be one: a call can carry no others. */
export function isToken(text: string): boolean {
  return /^[\x21-\x7e]+$/.test(text);
}

export const withToken: Interceptor = (next) => (request) => {
  if (held !== undefined) request.header.set("authorization", `Bearer ${held}`);
  return next(request);
};
