// Memory of a program that computes with long signals.
#pragma once

namespace twinrate {

// Reserves the heap of this process and asks the kernel for large pages there, and keeps memory
// that was freed. The signals of a log are vectors of megabytes, made and freed hundreds of times:
// without it each is new memory from the kernel, a page fault for every 4 KiB. A limit of the
// address space (ulimit -v) leaves the heap as it was. For a program; a library leaves the
// allocator of its host alone.
void use_large_pages();

}  // namespace twinrate
