import multiprocessing
import os

import pytest

import kerf


def test_a_forked_process_is_told_that_the_connection_is_its_parents():
    if "fork" not in multiprocessing.get_all_start_methods():
        pytest.skip("processes are not forked here")
    forked = multiprocessing.get_context("fork")
    with kerf.Client("127.0.0.1:9", timeout_s=0.5) as client:
        here, there = forked.Pipe()
        process = forked.Process(target=_tell, args=(client, there))
        process.start()
        assert here.poll(20.0), "it waits for an answer"
        refused, is_open = here.recv()
        process.join()
        assert len(refused) == 2
        assert all("127.0.0.1:9" in words and 'context="spawn"' in words for words in refused), refused
        assert is_open, "a client of its own"
        # The parent's goes on.
        with pytest.raises(kerf.UnavailableError):
            client.scenes()


def _tell(client, to):
    refused = []
    for call in (client.scenes, client.wait_until_ready):
        try:
            call()
        except kerf.FailedPreconditionError as error:
            refused.append(str(error))
    client.close()
    own = kerf.Client("127.0.0.1:9")
    to.send((refused, own._transport._process == os.getpid()))
