#include "tools/large_pages.hpp"

#include <malloc.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>

namespace twinrate {
namespace {

constexpr int kReserved = 512 << 20;   // bytes of address space; memory only where it is written
constexpr int kOwnMapping = 32 << 20;  // larger vectors get a mapping of their own (glibc's limit)
constexpr std::uintptr_t kLargePage = 2 << 20;

}  // namespace

void use_large_pages() {
  mallopt(M_MMAP_THRESHOLD, kOwnMapping);
  mallopt(M_TRIM_THRESHOLD, kReserved);
  mallopt(M_ARENA_MAX, 1);  // the threads of a step take their signals from the same heap
  auto* const first = static_cast<char*>(sbrk(0));
  mallopt(M_TOP_PAD, kReserved);
  void* volatile grow = std::malloc(kOwnMapping / 2);  // more than the heap has left: it grows
  std::free(grow);
  mallopt(M_TOP_PAD, kOwnMapping / 2);
  char* const aligned = first + (kLargePage - reinterpret_cast<std::uintptr_t>(first) % kLargePage);
  auto* const end = static_cast<char*>(sbrk(0));
  if (end > aligned) madvise(aligned, static_cast<std::size_t>(end - aligned), MADV_HUGEPAGE);
}

}  // namespace twinrate
