using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.Threading;
using Kerf.V1;

namespace Kerf.Client
{
    /// <summary>Drives tools of a session on a thread of its own. One call is under way at a time and carries the newest pose of
    /// a tool: nothing is queued, however slow the network.</summary>
    public sealed class Driver : IDisposable
    {
        const string Method = "kerf.v1.ControlService/SendPose";
        // A tool that holds still is told again this often, so that its lease goes on.
        static readonly TimeSpan KeepAlive = TimeSpan.FromSeconds(0.4);

        // Of its thread.
        Server server;
        readonly string sessionId;
        readonly Thread thread;
        readonly object gate = new object();
        readonly Dictionary<uint, Wish> wishes = new Dictionary<uint, Wish>();
        readonly Dictionary<uint, Contact> contacts = new Dictionary<uint, Contact>();
        readonly AutoResetEvent isNew = new AutoResetEvent(false);
        string lease = "";
        ulong seq;
        volatile bool ends;

        sealed class Wish
        {
            public ToolPose Pose;
            public bool IsNew;
            public long SentAt;
        }

        /// <summary>What is wrong, in words; null while all is well.</summary>
        public string Trouble { get; private set; }

        /// <summary>Begins to drive.</summary>
        public Driver(Server server, string sessionId)
        {
            this.server = server;
            this.sessionId = sessionId;
            thread = new Thread(Run) { IsBackground = true, Name = "kerf-drive" };
            thread.Start();
        }

        /// <summary>Where a tool is to be now, m and unit quaternion, scene frame.</summary>
        /// <param name="opening">Fraction of their full opening that the jaws take.</param>
        public void Move(uint toolId, Vec3 positionM, Quat orientation, float opening = 1)
        {
            var pose = new ToolPose
            {
                ToolId = toolId,
                Pose = new Pose { PositionM = positionM, Orientation = orientation },
                Opening = opening,
            };
            Want(toolId, pose);
        }

        /// <summary>Takes a tool out of the scene.</summary>
        public void Lift(uint toolId) => Want(toolId, null);

        /// <summary>What a tool felt last; null before the first answer.</summary>
        public Contact ContactOf(uint toolId)
        {
            lock (gate) return contacts.TryGetValue(toolId, out var contact) ? contact : null;
        }

        /// <summary>Lifts every tool and sends no more.</summary>
        public void Dispose()
        {
            lock (gate)
            {
                foreach (var wish in wishes.Values)
                {
                    wish.IsNew = wish.IsNew || wish.Pose != null;
                    wish.Pose = null;
                }
            }
            ends = true;
            isNew.Set();
            thread.Join();
        }

        void Want(uint toolId, ToolPose pose)
        {
            lock (gate)
            {
                if (!wishes.TryGetValue(toolId, out var wish)) wishes[toolId] = wish = new Wish();
                wish.Pose = pose;
                wish.IsNew = true;
            }
            isNew.Set();
        }

        void Run()
        {
            while (true)
            {
                var request = Next();
                if (request != null) Send(request);
                else if (ends) return;
                else isNew.WaitOne(TimeSpan.FromTicks(KeepAlive.Ticks / 4));
            }
        }

        SendPoseRequest Next()
        {
            var now = Stopwatch.GetTimestamp();
            var keepAlive = (long)(KeepAlive.TotalSeconds * Stopwatch.Frequency);
            lock (gate)
            {
                uint? oldest = null;
                foreach (var entry in wishes)
                {
                    var wish = entry.Value;
                    var due = wish.IsNew || (wish.Pose != null && !ends && now - wish.SentAt > keepAlive);
                    // The one that waited longest, so that each gets its turn.
                    if (due && (oldest == null || wish.SentAt < wishes[oldest.Value].SentAt)) oldest = entry.Key;
                }
                if (oldest == null) return null;
                var next = wishes[oldest.Value];
                next.IsNew = false;
                next.SentAt = now;
                var request = new SendPoseRequest { SessionId = sessionId, Lease = lease };
                if (next.Pose == null)
                {
                    request.Lift = new LiftTool { ToolId = oldest.Value };
                    return request;
                }
                request.Pose = next.Pose.Clone();
                request.Pose.Seq = ++seq;
                request.Pose.ClientNs = (ulong)(now * (1e9 / Stopwatch.Frequency));
                return request;
            }
        }

        /// <summary>What there is to do where a tool is kept out of tissue that it has not come into by moving.</summary>
        static string Waits(Contact contact)
        {
            var waits = contact != null && (contact.Flags & (uint)ContactFlag.WaitsUntilClear) != 0;
            return waits ? "lift the tool clear of the tissue" : null;
        }

        void Send(SendPoseRequest request)
        {
            try
            {
                var answer = server.Call(Method, request, SendPoseResponse.Parser);
                lease = answer.Lease;
                Trouble = answer.Rejected == null ? Waits(answer.Contact) : answer.Rejected.Field + ": " + answer.Rejected.Limit;
                if (answer.Contact == null) return;
                lock (gate) contacts[answer.Contact.ToolId] = answer.Contact;
            }
            catch (KerfException error)
            {
                // A lease that ran out is asked for anew, and each server has its own.
                if (error.Code == StatusCode.FailedPrecondition || error.MovedTo != null) lease = "";
                server = server.Follow(error) ?? server;
                Trouble = error.Message;
                if (error.Code == StatusCode.Unavailable && !ends) Thread.Sleep(KeepAlive);
            }
        }
    }
}
