using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using System.Net;
using System.Net.Security;
using System.Security.Cryptography;
using System.Security.Cryptography.X509Certificates;
using System.Text;

namespace Kerf.Client
{
    /// <summary>Whom a client takes for its server besides those whom the system trusts: the one that has the certificate of a file,
    /// by whatever name it was called, and each whose certificate that one has signed, by the names that stand in it.</summary>
    sealed class Trust
    {
        const string AlternativeNames = "2.5.29.17";
        const string ServerAuthentication = "1.3.6.1.5.5.7.3.1";
        const byte Sequence = 0x30, DnsName = 0x82, IpAddress = 0x87;

        readonly string file;
        readonly X509Certificate2 known;

        /// <exception cref="KerfException">The file holds no certificate.</exception>
        public Trust(string file)
        {
            this.file = file;
            try
            {
                known = new X509Certificate2(file);
            }
            catch (Exception error) when (error is CryptographicException || error is IOException)
            {
                throw new KerfException(StatusCode.InvalidArgument, file + " holds no certificate (PEM): " + error.Message, error);
            }
        }

        /// <summary>Connections are kept and used again: not by clients that would not have made them.</summary>
        public string Group => known.GetCertHashString();

        /// <summary>Why a certificate is not taken; null where it is.</summary>
        public string Refusal(string host, X509Certificate shown, X509Chain sent, SslPolicyErrors wrong)
        {
            if (wrong == SslPolicyErrors.None) return null;
            if (shown == null) return "the server shows no certificate";
            var leaf = new X509Certificate2(shown);
            if (AreSame(leaf, known)) return DateTime.Now < known.NotAfter ? null : "the certificate of " + file + " has expired";
            if (!IsAuthority(known)) return "the server shows another certificate than " + file + ", which is no authority's";
            return SignatureRefusal(leaf, sent) ?? UseRefusal(leaf) ?? NameRefusal(host, leaf);
        }

        string SignatureRefusal(X509Certificate2 leaf, X509Chain sent)
        {
            var chain = new X509Chain();
            chain.ChainPolicy.RevocationMode = X509RevocationMode.NoCheck;
            chain.ChainPolicy.VerificationFlags = X509VerificationFlags.AllowUnknownCertificateAuthority;
            chain.ChainPolicy.ExtraStore.Add(known);
            if (sent != null)
            {
                // Certificates that lead from the authority to the server's are sent with it; runtimes put them in either place.
                chain.ChainPolicy.ExtraStore.AddRange(sent.ChainPolicy.ExtraStore);
                foreach (var element in sent.ChainElements) chain.ChainPolicy.ExtraStore.Add(element.Certificate);
            }
            try
            {
                chain.Build(leaf);
            }
            catch (Exception error) when (error is NotSupportedException || error is CryptographicException)
            {
                return "this runtime does not check signatures of elliptic curves, and an authority's key between " + file +
                    " and the server is one: have an RSA key sign, or name the server's own certificate (" + error.Message + ")";
            }
            // That the authority is not the system's is the one thing that may be wrong.
            var faults = chain.ChainElements.Cast<X509ChainElement>().SelectMany(element => element.ChainElementStatus)
                .Concat(chain.ChainStatus).Select(status => status.Status)
                .Where(status => status != X509ChainStatusFlags.NoError && status != X509ChainStatusFlags.UntrustedRoot).Distinct().ToList();
            var root = chain.ChainElements.Count == 0 ? leaf : chain.ChainElements[chain.ChainElements.Count - 1].Certificate;
            if (faults.Count == 0 && AreSame(root, known)) return null;
            return "the server's certificate is not signed by " + file + (faults.Count == 0 ? "" : " as it should be: " + string.Join(", ", faults));
        }

        /// <summary>An authority signs certificates of people and mail, too, and their holders are no servers.</summary>
        static string UseRefusal(X509Certificate2 leaf)
        {
            var uses = leaf.Extensions.OfType<X509EnhancedKeyUsageExtension>().SelectMany(extension => extension.EnhancedKeyUsages.Cast<Oid>()).ToList();
            var isServer = uses.Count == 0 || uses.Any(use => use.Value == ServerAuthentication);
            return isServer ? null : "the certificate that the server shows is not one for servers (extended key usage)";
        }

        /// <summary>By RFC 6125: mono reports a name that is wrong only where nothing else is.</summary>
        static string NameRefusal(string host, X509Certificate2 leaf)
        {
            var names = leaf.Extensions.Cast<X509Extension>().Where(extension => extension.Oid.Value == AlternativeNames)
                .SelectMany(extension => Names(extension.RawData)).ToList();
            var isAddress = IPAddress.TryParse(host.Trim('[', ']'), out var address);
            var isNamed = isAddress
                ? names.Any(name => name.Key == IpAddress && name.Value.SequenceEqual(address.GetAddressBytes()))
                : names.Any(name => name.Key == DnsName && Matches(Encoding.ASCII.GetString(name.Value), host));
            return isNamed ? null : "the server's certificate is not made out to " + host;
        }

        /// <summary>A star stands for the whole first label.</summary>
        static bool Matches(string name, string host)
        {
            if (name.Equals(host, StringComparison.OrdinalIgnoreCase)) return true;
            var dot = host.IndexOf('.');
            return name.StartsWith("*.") && name.IndexOf('.', 2) > 0 && dot > 0 &&
                name.Substring(1).Equals(host.Substring(dot), StringComparison.OrdinalIgnoreCase);
        }

        /// <summary>The entries of GeneralNames (RFC 5280, 4.2.1.6) by their tag; none where it is cut short.</summary>
        static List<KeyValuePair<byte, byte[]>> Names(byte[] der)
        {
            var names = new List<KeyValuePair<byte, byte[]>>();
            var at = 0;
            if (!Enter(der, ref at, out var tag, out var length) || tag != Sequence || at + length != der.Length) return names;
            while (at < der.Length && Enter(der, ref at, out tag, out length))
            {
                names.Add(new KeyValuePair<byte, byte[]>(tag, der.Skip(at).Take(length).ToArray()));
                at += length;
            }
            return names;
        }

        /// <summary>Reads a tag and a length of DER; false where the bytes that it announces are not there.</summary>
        static bool Enter(byte[] der, ref int at, out byte tag, out int length)
        {
            tag = 0;
            length = 0;
            if (at + 2 > der.Length) return false;
            tag = der[at++];
            length = der[at++];
            if (length >= 0x80)
            {
                var more = length - 0x80;
                length = 0;
                if (more > 3 || at + more > der.Length) return false;
                for (; more > 0; more--) length = length << 8 | der[at++];
            }
            return at + length <= der.Length;
        }

        static bool IsAuthority(X509Certificate2 certificate)
        {
            return certificate.Extensions.OfType<X509BasicConstraintsExtension>().Any(extension => extension.CertificateAuthority);
        }

        static bool AreSame(X509Certificate one, X509Certificate other)
        {
            return one.GetRawCertData().SequenceEqual(other.GetRawCertData());
        }
    }
}
