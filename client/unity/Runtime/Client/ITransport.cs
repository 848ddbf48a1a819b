using System;
using System.Threading;

namespace Kerf.Client
{
    /// <summary>Carries calls to a server. The one that comes with this package speaks gRPC-Web; an engine with HTTP/2 may
    /// bring its own.</summary>
    public interface ITransport
    {
        /// <summary>Carries calls to another server in the same way.</summary>
        /// <param name="address">As "https://kerf.example:50051".</param>
        ITransport To(string address);

        /// <summary>One request, one answer. Waits for it.</summary>
        /// <param name="method">Full name, as "kerf.v1.SessionService/ListScenes".</param>
        /// <param name="request">The request, in protobuf's encoding.</param>
        /// <param name="cancel">Ends the call early.</param>
        /// <exception cref="KerfException">The server refused, or could not be reached.</exception>
        byte[] Call(string method, byte[] request, CancellationToken cancel);

        /// <summary>One request, many answers. Returns when the server has ended the stream with OK.</summary>
        /// <param name="take">Called with each answer, one after the other.</param>
        /// <exception cref="KerfException">The server refused, or could not be reached.</exception>
        void Stream(string method, byte[] request, Action<byte[]> take, CancellationToken cancel);
    }
}
