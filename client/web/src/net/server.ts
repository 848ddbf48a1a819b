// Calls of the server that this page came from.

import { createClient, type Interceptor } from "@connectrpc/connect";
import { createGrpcWebTransport } from "@connectrpc/connect-web";
import { ControlService } from "../gen/kerf/v1/control_pb";
import { SessionService } from "../gen/kerf/v1/session_pb";
import { ViewService } from "../gen/kerf/v1/view_pb";
import { isUnknownHere } from "./errors";
import { withToken } from "./token";

/** Tells whoever is to know that the server asks for a token, or for another one. */
const tellsRefusals: Interceptor = (next) => async (request) => {
  try {
    return await next(request);
  } catch (error) {
    if (isUnknownHere(error)) onUnknown();
    throw error;
  }
};

let onUnknown = () => {};

/** Says what is done when the server asks for a token. */
export function whenUnknown(act: () => void): void {
  onUnknown = act;
}

const transport = createGrpcWebTransport({ baseUrl: location.origin, interceptors: [tellsRefusals, withToken] });

export const sessions = createClient(SessionService, transport);
export const control = createClient(ControlService, transport);
/** Its calls; streams have a worker of their own. */
export const views = createClient(ViewService, transport);
