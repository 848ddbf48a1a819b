using System.Collections.Generic;
using Kerf.V1;

namespace Kerf.Client
{
    /// <summary>A session's objects as a viewer has them, made from the view stream alone. One thread at a time may use it.
    /// Everything is in the scene frame: right-handed, metres, y up, z toward the user. Unity's is left-handed: mirror z and
    /// turn triangles round.</summary>
    public sealed class Replica
    {
        readonly List<Body> bodies = new List<Body>();
        ulong? version;
        bool hasPlainVertices;

        /// <summary>In the order of SceneSummary.objects; new ones with each keyframe.</summary>
        public IReadOnlyList<Body> Bodies => bodies;

        /// <summary>Rises with each keyframe and patch: triangles are to be made anew.</summary>
        public int StructureCount { get; private set; }

        /// <summary>The newest state that was taken; its displacements are in the bodies.</summary>
        public State State { get; private set; }

        /// <summary>The hash that the newest keyframe or patch states for this surface; none of plain vertices.</summary>
        public ulong StatedHash { get; private set; }

        /// <summary>The hash of this surface, from what is here.</summary>
        public ulong Hash()
        {
            ulong hash = 0;
            foreach (var body in bodies) hash = SurfaceHash.Fold(hash, body.HashSum);
            return hash;
        }

        /// <summary>Takes a message; true where it changed what is seen. A patch or a state of another version is left
        /// out: a keyframe follows.</summary>
        /// <exception cref="MalformedException">The message is not what the protocol says; join anew.</exception>
        public bool Take(ViewResponse message)
        {
            switch (message.MessageCase)
            {
                case ViewResponse.MessageOneofCase.Keyframe:
                    bodies.Clear();
                    hasPlainVertices = message.Keyframe.Encoding == SurfaceEncoding.Vertices;
                    foreach (var _ in message.Keyframe.Bodies) bodies.Add(new Body(hasPlainVertices));
                    Change(message.Keyframe.Bodies, message.Keyframe.TopologyVersion, message.Keyframe.SurfaceHash);
                    return true;
                case ViewResponse.MessageOneofCase.Patch:
                    if (version != message.Patch.FromVersion) return false;
                    Change(message.Patch.Bodies, message.Patch.ToVersion, message.Patch.SurfaceHash);
                    return true;
                case ViewResponse.MessageOneofCase.State:
                    return Move(message.State);
                default:
                    return false;
            }
        }

        void Change(IList<BodyStructure> changes, ulong to, ulong statedHash)
        {
            if (changes.Count != bodies.Count) throw new MalformedException("bodies", bodies.Count + " entries");
            // Until all of it is in, the surface is of no version.
            version = null;
            var room = Body.MaxNodes;
            for (var i = 0; i < changes.Count; i++)
            {
                bodies[i].Change(changes[i], room);
                room -= changes[i].NodeCount;
            }
            StatedHash = statedHash;
            if (!hasPlainVertices && Hash() != statedHash) throw new MalformedException("surface_hash", "the hash of what came before it");
            version = to;
            StructureCount++;
        }

        bool Move(State state)
        {
            if (version != state.TopologyVersion) return false;
            if (state.Bodies.Count != bodies.Count) throw new MalformedException("bodies", bodies.Count + " entries");
            for (var i = 0; i < bodies.Count; i++) bodies[i].Move(state.Bodies[i], state.HasReference);
            State = state;
            return true;
        }
    }
}
