using System;
using System.Collections.Generic;
using System.Threading;
using Google.Protobuf;
using Kerf.V1;

namespace Kerf.Client
{
    /// <summary>The calls of a server, typed. Each waits for its answer: call from a thread that may wait.</summary>
    public sealed class Server
    {
        const string Sessions = "kerf.v1.SessionService/";

        /// <summary>Version of the protocol that this package speaks.</summary>
        public const uint ProtocolVersion = 3;

        readonly ITransport transport;

        /// <summary>A server that is reached over gRPC-Web.</summary>
        /// <param name="address">As "http://127.0.0.1:50051" or "https://kerf.example:50051".</param>
        /// <param name="token">Sent as a bearer token where the server asks for one.</param>
        /// <param name="certificateFile">Certificate (PEM) of the server, or of the authority that has signed it, where the system
        /// does not trust it.</param>
        public Server(string address, string token = null, string certificateFile = null)
            : this(new GrpcWebTransport(address, token, certificateFile))
        {
        }

        /// <summary>A server that is reached over a transport of one's own.</summary>
        public Server(ITransport transport)
        {
            this.transport = transport;
        }

        /// <summary>The server that a session has moved to, where that is why a call failed; else null. It is asked with the same
        /// token and certificate.</summary>
        public Server Follow(KerfException error)
        {
            return error.MovedTo == null ? null : new Server(transport.To(error.MovedTo));
        }

        /// <summary>The scenes that can be started by name.</summary>
        public IReadOnlyList<SceneInfo> ListScenes()
        {
            return Call(Sessions + "ListScenes", new ListScenesRequest(), ListScenesResponse.Parser).Scenes;
        }

        /// <summary>The sessions that run.</summary>
        public IReadOnlyList<SessionInfo> ListSessions()
        {
            return Call(Sessions + "ListSessions", new ListSessionsRequest(), ListSessionsResponse.Parser).Sessions;
        }

        /// <summary>Starts a session.</summary>
        /// <param name="tell">Called meanwhile with how far its scene is.</param>
        public SessionDescription Create(CreateSessionRequest request, Action<MakingProgress> tell = null)
        {
            const string method = Sessions + "MakeSession";
            SessionDescription made = null;
            Stream(method, new MakeSessionRequest { Request = request }, MakeSessionResponse.Parser, answer =>
            {
                if (answer.Created != null) made = answer.Created.Session;
                else if (answer.Progress != null) tell?.Invoke(answer.Progress);
            }, CancellationToken.None);
            return made ?? throw new KerfException(StatusCode.Internal, method + " ended without a session");
        }

        /// <summary>Starts a session of a scene that the server knows.</summary>
        public SessionDescription Create(string sceneName)
        {
            return Create(new CreateSessionRequest { SceneName = sceneName });
        }

        /// <summary>How a session is doing.</summary>
        public SessionDescription Describe(string sessionId)
        {
            var request = new DescribeSessionRequest { SessionId = sessionId };
            return Call(Sessions + "DescribeSession", request, DescribeSessionResponse.Parser).Session;
        }

        /// <summary>Lets a session stand. Returns the step after which it does.</summary>
        public ulong Pause(string sessionId)
        {
            return Call(Sessions + "PauseSession", new PauseSessionRequest { SessionId = sessionId }, PauseSessionResponse.Parser).Step;
        }

        /// <summary>Lets a session go on. Returns the step from which it does.</summary>
        public ulong Resume(string sessionId)
        {
            return Call(Sessions + "ResumeSession", new ResumeSessionRequest { SessionId = sessionId }, ResumeSessionResponse.Parser).Step;
        }

        /// <summary>Puts the scene back to rest.</summary>
        public void Reset(string sessionId)
        {
            Call(Sessions + "ResetSession", new ResetSessionRequest { SessionId = sessionId }, ResetSessionResponse.Parser);
        }

        /// <summary>Saves the state under a name.</summary>
        public void Save(string sessionId, string name)
        {
            var request = new SaveCheckpointRequest { SessionId = sessionId, Name = name };
            Call(Sessions + "SaveCheckpoint", request, SaveCheckpointResponse.Parser);
        }

        /// <summary>Goes back to a saved state.</summary>
        public void Restore(string sessionId, string name)
        {
            var request = new RestoreCheckpointRequest { SessionId = sessionId, Name = name };
            Call(Sessions + "RestoreCheckpoint", request, RestoreCheckpointResponse.Parser);
        }

        /// <summary>Ends a session.</summary>
        public void Close(string sessionId)
        {
            Call(Sessions + "CloseSession", new CloseSessionRequest { SessionId = sessionId }, CloseSessionResponse.Parser);
        }

        internal T Call<T>(string method, IMessage request, MessageParser<T> answer, CancellationToken cancel = default)
            where T : IMessage<T>
        {
            return Parse(method, answer, transport.Call(method, request.ToByteArray(), cancel));
        }

        internal void Stream<T>(string method, IMessage request, MessageParser<T> answer, Action<T> take, CancellationToken cancel)
            where T : IMessage<T>
        {
            transport.Stream(method, request.ToByteArray(), bytes => take(Parse(method, answer, bytes)), cancel);
        }

        static T Parse<T>(string method, MessageParser<T> parser, byte[] bytes)
            where T : IMessage<T>
        {
            try
            {
                return parser.ParseFrom(bytes);
            }
            catch (InvalidProtocolBufferException error)
            {
                throw new KerfException(StatusCode.Internal, method + " answered what is not protobuf", error);
            }
        }
    }
}
