using System;
using System.Collections.Generic;
using System.IO;
using System.Net;
using System.Text;
using System.Threading;

namespace Kerf.Client
{
    /// <summary>gRPC-Web over HTTP/1.1, which every runtime has: a POST per call. Each message is framed by a byte of flags and
    /// its length, big-endian; the frame whose flags have bit 7 holds the status.</summary>
    public sealed class GrpcWebTransport : ITransport
    {
        const byte StatusFlag = 0x80;
        // Of the status of whoever asks for a session that has moved.
        const string MovedTo = "kerf-moved-to";
        // A server sends no message above 4 MiB; more is no answer of one.
        const int MaxMessageBytes = 4 << 20;

        readonly string address;
        readonly string token;
        readonly Trust trust;

        /// <param name="address">As "http://127.0.0.1:50051" or "https://kerf.example:50051".</param>
        /// <param name="token">Sent as a bearer token where the server asks for one.</param>
        /// <param name="certificateFile">Certificate (PEM) of the server, or of the authority that has signed it, where the system
        /// does not trust it. The server's own is taken under any name, a signed one under the names that stand in it.</param>
        /// <exception cref="KerfException">The file holds no certificate.</exception>
        public GrpcWebTransport(string address, string token = null, string certificateFile = null)
            : this(address, token, string.IsNullOrEmpty(certificateFile) ? null : new Trust(certificateFile))
        {
        }

        GrpcWebTransport(string address, string token, Trust trust)
        {
            this.address = address.TrimEnd('/');
            this.token = token;
            this.trust = trust;
            // A viewer's stream, its acknowledgements and a driver go side by side.
            ServicePointManager.DefaultConnectionLimit = Math.Max(ServicePointManager.DefaultConnectionLimit, 16);
        }

        /// <inheritdoc/>
        public ITransport To(string other)
        {
            return new GrpcWebTransport(other, token, trust);
        }

        /// <inheritdoc/>
        public byte[] Call(string method, byte[] request, CancellationToken cancel)
        {
            byte[] answer = null;
            Stream(method, request, message => answer = message, cancel);
            return answer ?? throw new KerfException(StatusCode.Internal, method + " was not answered");
        }

        /// <inheritdoc/>
        public void Stream(string method, byte[] request, Action<byte[]> take, CancellationToken cancel)
        {
            // The exception of a handshake does not say why the certificate was refused.
            string refusal = null;
            var http = Request(method, why => refusal = why);
            using (cancel.Register(http.Abort))
            {
                try
                {
                    Write(http, request);
                    using (var response = (HttpWebResponse)http.GetResponse())
                    using (var body = response.GetResponseStream())
                    {
                        Read(method, response.Headers, body, take);
                    }
                }
                catch (Exception error) when (error is WebException || error is IOException || error is ObjectDisposedException)
                {
                    if (cancel.IsCancellationRequested) throw new KerfException(StatusCode.Cancelled, method + " was cancelled", error);
                    throw new KerfException(StatusCode.Unavailable, address + " does not answer: " + (refusal ?? error.Message), error);
                }
            }
        }

        HttpWebRequest Request(string method, Action<string> refuse)
        {
            var http = (HttpWebRequest)WebRequest.Create(address + "/" + method);
            http.Method = "POST";
            http.ContentType = "application/grpc-web+proto";
            http.Headers["X-Grpc-Web"] = "1";
            if (!string.IsNullOrEmpty(token)) http.Headers["Authorization"] = "Bearer " + token;
            if (trust != null)
            {
                var host = http.RequestUri.DnsSafeHost;
                http.ServerCertificateValidationCallback = (sender, shown, chain, wrong) =>
                {
                    var why = trust.Refusal(host, shown, chain, wrong);
                    refuse(why);
                    return why == null;
                };
                http.ConnectionGroupName = trust.Group;
            }
            http.ServicePoint.Expect100Continue = false;
            http.ServicePoint.UseNagleAlgorithm = false;
            http.ReadWriteTimeout = Timeout.Infinite;
            return http;
        }

        static void Write(HttpWebRequest http, byte[] request)
        {
            var frame = new byte[5 + request.Length];
            for (var i = 0; i < 4; i++) frame[1 + i] = (byte)(request.Length >> (8 * (3 - i)));
            request.CopyTo(frame, 5);
            http.ContentLength = frame.Length;
            using (var body = http.GetRequestStream()) body.Write(frame, 0, frame.Length);
        }

        static void Read(string method, WebHeaderCollection headers, Stream body, Action<byte[]> take)
        {
            // A call that is refused at once has its status among the headers, and no body.
            if (headers["grpc-status"] != null) Check(method, headers["grpc-status"], headers["grpc-message"], headers[MovedTo]);
            var header = new byte[5];
            while (Fill(body, header))
            {
                var length = header[1] << 24 | header[2] << 16 | header[3] << 8 | header[4];
                if (length < 0 || length > MaxMessageBytes) throw new KerfException(StatusCode.Internal, method + " answered with " + (uint)length + " bytes");
                var message = new byte[length];
                if (!Fill(body, message)) break;
                if ((header[0] & StatusFlag) == 0)
                {
                    take(message);
                    continue;
                }
                var trailers = Trailers(message);
                trailers.TryGetValue("grpc-status", out var status);
                trailers.TryGetValue("grpc-message", out var why);
                trailers.TryGetValue(MovedTo, out var movedTo);
                Check(method, status, why, movedTo);
                return;
            }
            if (headers["grpc-status"] == null) throw new KerfException(StatusCode.Unavailable, method + " ended without a status: the connection broke");
        }

        /// <summary>Reads until the buffer is full; false where the stream ends before.</summary>
        static bool Fill(Stream body, byte[] buffer)
        {
            for (var have = 0; have < buffer.Length;)
            {
                var got = body.Read(buffer, have, buffer.Length - have);
                if (got == 0) return false;
                have += got;
            }
            return true;
        }

        static Dictionary<string, string> Trailers(byte[] block)
        {
            var trailers = new Dictionary<string, string>(StringComparer.OrdinalIgnoreCase);
            foreach (var line in Encoding.ASCII.GetString(block).Split(new[] { "\r\n" }, StringSplitOptions.RemoveEmptyEntries))
            {
                var colon = line.IndexOf(':');
                if (colon > 0) trailers[line.Substring(0, colon).Trim()] = line.Substring(colon + 1).Trim();
            }
            return trailers;
        }

        static void Check(string method, string status, string why, string movedTo)
        {
            if (!int.TryParse(status, out var code)) throw new KerfException(StatusCode.Internal, method + " ended with status \"" + status + "\"");
            if (code != 0) throw new KerfException((StatusCode)code, Uri.UnescapeDataString(why ?? "no reason given"), null, movedTo);
        }
    }
}
