"""Reading what ptxas and the device linker say about registers, stack and spills."""

from __future__ import annotations

import pytest

from yasps.runtime.build.cuda.report import (
    FunctionResources,
    ReportFormatError,
    functions_of_module,
    kernels_of_program,
    linked_functions,
)

MODULE = """\
spring.cu(3): warning #177-D: variable "s" was declared but never referenced
ptxas info    : 0 bytes gmem
ptxas info    : Compiling entry function 'spring' for 'sm_90'
ptxas info    : Function properties for spring
ptxas         .     1600 bytes stack frame, 24 bytes spill stores, 40 bytes spill loads
ptxas info    : Used 52 registers, used 1 barriers, 1072 bytes smem, 372 bytes cmem[0]
ptxas info    : Compile time = 218.906 ms
ptxas info    : Function properties for _Z5helperd
    96 bytes stack frame, 0 bytes spill stores, 8 bytes spill loads
ptxas info    : Compile time = 1.150 ms
"""
PROGRAM = """\
nvlink info    : 28 bytes gmem
nvlink info    : Function properties for 'other':
nvlink info    : used 16 registers, used 0 barriers, 0 stack, 48 bytes smem, 548 bytes cmem[0], 0 bytes lmem
nvlink info    : Function properties for 'spring':
nvlink info    : used 60 registers, used 1 barriers, 4008 stack, 1072 bytes smem, 0 bytes lmem
"""


def test_functions_of_a_module() -> None:
    assert functions_of_module(MODULE) == {
        "spring": FunctionResources("spring", True, 52, 1600, 64, 1072),
        "_Z5helperd": FunctionResources("_Z5helperd", False, 0, 96, 8, 0),
    }
    assert functions_of_module("") == {}


def test_kernels_have_the_linkers_figures_and_the_spills_of_ptxas() -> None:
    kernels = kernels_of_program(PROGRAM)
    assert set(kernels) == {"other", "spring"}
    assert kernels["other"] == FunctionResources("other", True, 16, 0, 0, 48)
    assert linked_functions(MODULE, kernels) == (
        FunctionResources("spring", True, 60, 4008, 64, 1072),
        FunctionResources("_Z5helperd", False, 0, 96, 8, 0),
    )


def test_words_that_are_not_known_are_an_error_and_not_zeros() -> None:
    with pytest.raises(ReportFormatError, match="of spring in what `ptxas -v`"):
        functions_of_module(MODULE.replace("Used 52 registers", "52 registers taken"))
    with pytest.raises(ReportFormatError, match="of spring in what `ptxas -v`"):
        functions_of_module(MODULE.replace("1600 bytes stack frame", "stack frame 1600"))
    with pytest.raises(ReportFormatError, match="nvlink"):
        kernels_of_program(PROGRAM.replace("4008 stack", "stack 4008"))
    with pytest.raises(ReportFormatError, match="of spring in what `nvlink"):
        linked_functions(MODULE, kernels_of_program(PROGRAM.replace("'spring'", "'spruce'")))
