using System;

namespace Kerf.Client
{
    /// <summary>The codes of gRPC that the server answers with.</summary>
    public enum StatusCode
    {
        /// <summary>All is well.</summary>
        Ok = 0,
        /// <summary>The call was cancelled.</summary>
        Cancelled = 1,
        /// <summary>No known reason.</summary>
        Unknown = 2,
        /// <summary>A field of the request is wrong; the message names it.</summary>
        InvalidArgument = 3,
        /// <summary>No such session, scene, tool or viewer.</summary>
        NotFound = 5,
        /// <summary>The token is not good for this, or the session is somebody else's.</summary>
        PermissionDenied = 7,
        /// <summary>The server is full; the message names the limit.</summary>
        ResourceExhausted = 8,
        /// <summary>Another protocol version, or somebody else drives the tool.</summary>
        FailedPrecondition = 9,
        /// <summary>The server does not know the method.</summary>
        Unimplemented = 12,
        /// <summary>The server failed, or what it sent cannot be read.</summary>
        Internal = 13,
        /// <summary>The server could not be reached, or the connection broke.</summary>
        Unavailable = 14,
        /// <summary>The server asks for a token, or does not know the one that was sent.</summary>
        Unauthenticated = 16,
    }

    /// <summary>A call failed.</summary>
    public sealed class KerfException : Exception
    {
        /// <summary>Why, as a code.</summary>
        public StatusCode Code { get; }

        /// <summary>Address of the server that the session has moved to; null where it has not.</summary>
        public string MovedTo { get; }

        /// <summary>A failure with its reason in words.</summary>
        public KerfException(StatusCode code, string message, Exception cause = null, string movedTo = null)
            : base(message, cause)
        {
            Code = code;
            MovedTo = movedTo;
        }
    }
}
