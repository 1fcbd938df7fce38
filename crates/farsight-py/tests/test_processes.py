"""Threads and processes."""

import concurrent.futures
import multiprocessing
import os
import pickle
import subprocess
import sys
import threading

import farsight
import pytest


def test_several_threads_use_one_model(model, photo):
    alone = model.range(photo, hfov=81.4).to_json()
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(lambda _: model.range(photo, hfov=81.4).to_json(), range(8)))
    assert answers == [alone] * 8


@pytest.mark.slice
def test_other_threads_run_while_a_model_looks(model, photo):
    """Python's lock is free meanwhile: a thread that only counts goes on, in steps of far less than one look."""
    is_done, steps = threading.Event(), []

    def count():
        while not is_done.wait(0.001):
            steps.append(1)

    counter = threading.Thread(target=count)
    counter.start()
    model.range(photo, hfov=81.4)
    is_done.set()
    counter.join()
    assert len(steps) > 3


@pytest.mark.slice
def test_a_model_pickles_as_its_arguments(photo):
    model = farsight.Model(model="farsight-s", threads=1)
    again = pickle.loads(pickle.dumps(model))
    assert repr(again) == repr(model) and len(pickle.dumps(model)) < 1000
    assert again.range(photo).to_json() == model.range(photo).to_json()


def look(arguments):
    model, photo = arguments
    return model.range(photo, hfov=81.4)


def test_other_processes_take_models_and_give_results(model, photo, result):
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        answers = pool.map(look, [(model, photo)] * 2)
    assert [answer.to_json() for answer in answers] == [result.to_json()] * 2


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_forked_process_is_told_instead_of_waiting_for_ever(model, photo):
    model.range(photo)
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            model.range(photo)
            told = "nothing"
        except RuntimeError as error:
            told = str(error)
        os.write(writer, told.encode())
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, encoding="utf-8") as told:
        assert 'expected the start method "spawn" or "forkserver"' in told.read()
    assert os.waitpid(child, 0)[1] == 0


@pytest.mark.slice
def test_nothing_but_numpy_is_imported():
    code = "import sys; before = set(sys.modules); import farsight\n"
    code += "print(sorted({m.split('.')[0] for m in set(sys.modules) - before} - set(sys.stdlib_module_names)))"
    printed = subprocess.run([sys.executable, "-I", "-c", code], check=True, capture_output=True, text=True).stdout
    assert printed.strip() == "['farsight', 'numpy']"
