// Errors in words: what happened, and what to do.

import { Code, ConnectError } from "@connectrpc/connect";

/** The session is not there, or no more. */
export function isGone(error: unknown): boolean {
  return ConnectError.from(error).code === Code.NotFound;
}

/** Where the session that was asked for has moved, if it has. */
export function movedTo(error: unknown): string | undefined {
  const to = ConnectError.from(error).metadata.get("kerf-moved-to");
  return to !== null && /^https?:\/\//.test(to) ? to : undefined;
}

/** The server does not know who this is: it asks for a token, or for another one. */
export function isUnknownHere(error: unknown): boolean {
  return ConnectError.from(error).code === Code.Unauthenticated;
}

/** Nothing was refused: the answer did not come. */
export function isUnreachable(error: unknown): boolean {
  const { code } = ConnectError.from(error);
  return code === Code.Unavailable || code === Code.Unknown || code === Code.Internal;
}

export function inWords(error: unknown): string {
  const { code, rawMessage } = ConnectError.from(error);
  switch (code) {
    case Code.Unavailable:
    case Code.Unknown:
    case Code.Internal:
      return "The server does not answer. Is it still running, and is the network there?";
    case Code.DeadlineExceeded:
      return "The server took too long to answer. It may be busy building a large scene; try again.";
    case Code.ResourceExhausted:
      if (rawMessage.includes("_bytes)")) return `This is too large for the server: ${rawMessage}.`;
      return `The server is full: ${rawMessage}. End a session that nobody needs, then try again.`;
    case Code.NotFound:
      if (rawMessage.startsWith("upload_id")) return "The server does not have the files any more. Choose them again.";
      return "This session is not there any more. The server was restarted, or somebody ended it.";
    case Code.InvalidArgument:
      return `The server cannot use this: ${rawMessage}. Change that value and try again.`;
    case Code.Unauthenticated:
      return "The server does not let this page in without a token that it knows. Sign in with yours.";
    default:
      return `The server refused: ${rawMessage}.`;
  }
}
