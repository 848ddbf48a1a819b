// Calls of the server that this page came from.

import { createClient } from "@connectrpc/connect";
import { createGrpcWebTransport } from "@connectrpc/connect-web";
import { ControlService } from "../gen/kerf/v1/control_pb";
import { SessionService } from "../gen/kerf/v1/session_pb";
import { ViewService } from "../gen/kerf/v1/view_pb";

const transport = createGrpcWebTransport({ baseUrl: location.origin });

export const sessions = createClient(SessionService, transport);
export const control = createClient(ControlService, transport);
/** Its calls; streams have a worker of their own. */
export const views = createClient(ViewService, transport);
