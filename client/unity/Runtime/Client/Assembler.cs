using System.IO;
using Google.Protobuf;
using Kerf.V1;

namespace Kerf.Client
{
    /// <summary>Puts fragments together to the message that they are parts of.</summary>
    public sealed class Assembler
    {
        /// <summary>What a whole message may hold, bytes: the largest that the server sends.</summary>
        internal const int MaxBytes = 64 * 1024 * 1024;

        readonly MemoryStream data = new MemoryStream();
        uint remaining;

        /// <summary>A whole message, or null where more fragments are to come.</summary>
        public ViewResponse Take(ViewResponse message)
        {
            var isFragment = message.MessageCase == ViewResponse.MessageOneofCase.Fragment;
            var isFirst = data.Length == 0;
            if (!isFragment)
            {
                if (!isFirst) throw new MalformedException("fragment", remaining + " more");
                return message;
            }
            var fragment = message.Fragment;
            if (!isFirst && fragment.Remaining != remaining - 1) throw new MalformedException("fragment.remaining", (remaining - 1).ToString());
            if (data.Length + fragment.Data.Length > MaxBytes) throw new MalformedException("fragment.data", "at most " + MaxBytes + " bytes in all");
            remaining = fragment.Remaining;
            fragment.Data.WriteTo(data);
            if (remaining > 0) return null;
            var whole = data.ToArray();
            data.SetLength(0);
            try
            {
                return ViewResponse.Parser.ParseFrom(whole);
            }
            catch (InvalidProtocolBufferException error)
            {
                throw new MalformedException("fragment.data", "a ViewResponse (" + error.Message + ")");
            }
        }
    }
}
