using System;

namespace Kerf.Client
{
    /// <summary>What the server sent is not what its protocol says. A viewer joins anew.</summary>
    public sealed class MalformedException : Exception
    {
        /// <summary>What is wrong where.</summary>
        public MalformedException(string field, string expected)
            : base(field + ": " + expected + " expected")
        {
        }
    }
}
