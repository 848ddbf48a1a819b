using Kerf.V1;
using UnityEngine;

namespace Kerf.Unity
{
    /// <summary>The scene frame is right-handed, Unity's left-handed: z is mirrored.</summary>
    public static class Frames
    {
        /// <summary>From Unity to the scene frame, m.</summary>
        public static Vec3 ToScene(Vector3 position) => new Vec3 { X = position.x, Y = position.y, Z = -position.z };

        /// <summary>From Unity to the scene frame.</summary>
        public static Quat ToScene(Quaternion rotation)
        {
            return new Quat { X = -rotation.x, Y = -rotation.y, Z = rotation.z, W = rotation.w };
        }

        /// <summary>From the scene frame to Unity.</summary>
        public static Vector3 ToUnity(Vec3 vector) => new Vector3(vector.X, vector.Y, -vector.Z);

        /// <summary>From the scene frame to Unity.</summary>
        public static Quaternion ToUnity(Quat rotation) => new Quaternion(-rotation.X, -rotation.Y, rotation.Z, rotation.W);
    }
}
