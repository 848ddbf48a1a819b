using System;
using System.Threading;
using Kerf.V1;

namespace Kerf.Client
{
    /// <summary>Follows a session on a thread of its own: reads the view stream, acknowledges it, keeps a replica, and joins
    /// anew when the connection breaks, the server starts again or the session moves to another one.</summary>
    public sealed class Viewer : IDisposable
    {
        const string View = "kerf.v1.ViewService/";
        static readonly TimeSpan RetryAfter = TimeSpan.FromSeconds(0.5);

        volatile Server server;
        readonly ViewRequest request;
        readonly CancellationTokenSource end = new CancellationTokenSource();
        readonly object gate = new object();
        readonly Thread reader;
        readonly Thread acknowledger;
        readonly AutoResetEvent isRead = new AutoResetEvent(false);
        Replica replica = new Replica();
        string viewer;
        ulong newest;
        bool isNew;

        /// <summary>What is wrong, in words, while it is; null while all is well.</summary>
        public string Trouble { get; private set; }

        /// <summary>The session has ended, or is not known to the server.</summary>
        public bool HasEnded { get; private set; }

        /// <summary>The server that has the session: another one than at first, once it has moved.</summary>
        public Server Server => server;

        /// <summary>Something happened to the session; called on the viewer's thread.</summary>
        public event Action<Event> Happened;

        /// <summary>Begins to follow a session.</summary>
        /// <param name="rateHz">States a second; 0: 60.</param>
        public Viewer(Server server, string sessionId, double rateHz = 0)
        {
            this.server = server;
            request = new ViewRequest
            {
                ProtocolVersion = Client.Server.ProtocolVersion,
                SessionId = sessionId,
                RateHz = rateHz,
                WantsEnergy = true,
            };
            reader = new Thread(Follow) { IsBackground = true, Name = "kerf-view" };
            acknowledger = new Thread(Acknowledge) { IsBackground = true, Name = "kerf-acknowledge" };
            reader.Start();
            acknowledger.Start();
        }

        /// <summary>Looks at the replica, if it changed since the last look. The stream waits for as long as it takes.</summary>
        /// <returns>Whether there was something new.</returns>
        public bool Look(Action<Replica> look)
        {
            lock (gate)
            {
                if (!isNew) return false;
                isNew = false;
                look(replica);
                return true;
            }
        }

        /// <summary>Leaves the session.</summary>
        public void Dispose()
        {
            end.Cancel();
            isRead.Set();
            reader.Join();
            acknowledger.Join();
            end.Dispose();
        }

        void Follow()
        {
            while (!end.IsCancellationRequested && !HasEnded)
            {
                try
                {
                    var assembler = new Assembler();
                    lock (gate) replica = new Replica();
                    server.Stream(View + "View", request, ViewResponse.Parser, message => Take(assembler, message), end.Token);
                    HasEnded = true;
                }
                catch (KerfException error) when (error.MovedTo != null)
                {
                    Trouble = error.Message;
                    server = server.Follow(error);
                }
                catch (KerfException error) when (IsFinal(error.Code))
                {
                    Trouble = error.Message;
                    HasEnded = true;
                }
                catch (Exception error) when (error is KerfException || error is MalformedException)
                {
                    Trouble = error.Message;
                    end.Token.WaitHandle.WaitOne(RetryAfter);
                }
            }
        }

        static bool IsFinal(StatusCode code)
        {
            return code == StatusCode.NotFound || code == StatusCode.FailedPrecondition
                || code == StatusCode.InvalidArgument || code == StatusCode.Unimplemented;
        }

        void Take(Assembler assembler, ViewResponse part)
        {
            var message = assembler.Take(part);
            if (message == null) return;
            Trouble = null;
            switch (message.MessageCase)
            {
                case ViewResponse.MessageOneofCase.Hello:
                    viewer = message.Hello.Viewer;
                    newest = 0;
                    break;
                case ViewResponse.MessageOneofCase.Event:
                    Happened?.Invoke(message.Event);
                    break;
            }
            lock (gate) isNew |= replica.Take(message);
            if (message.Number == 0) return;
            Volatile.Write(ref newest, message.Number);
            isRead.Set();
        }

        // Beside the reader, so that a slow way back does not hold up what comes; numbers stand for all before them.
        void Acknowledge()
        {
            while (isRead.WaitOne() && !end.IsCancellationRequested)
            {
                var said = new AcknowledgeRequest { Viewer = viewer, Number = Volatile.Read(ref newest) };
                try
                {
                    server.Call(View + "Acknowledge", said, AcknowledgeResponse.Parser, end.Token);
                }
                catch (KerfException)
                {
                    // The reader sees the same and says so.
                }
            }
        }
    }
}
