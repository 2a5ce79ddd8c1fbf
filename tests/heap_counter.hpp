// Counts calls of malloc and its kin, of operator new and delete, and of __cxa_throw, in the one translation unit of a
// test. Under a sanitizer that brings its own malloc, or another C library, IIM_COUNTS is not defined and nothing
// counts.
#pragma once

#include <atomic>
#include <cstdlib>
#include <new>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define IIM_OTHER_MALLOC 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define IIM_OTHER_MALLOC 1
#endif
#endif
#if defined(__GLIBC__) && !defined(IIM_OTHER_MALLOC)
#define IIM_COUNTS 1
#include <dlfcn.h>
#include <cerrno>
#endif

namespace {

std::atomic<long> heap_calls{0};
std::atomic<long> heap_bytes{0};  // asked for; what is given back does not count
std::atomic<long> throws{0};

}  // namespace

#ifdef IIM_COUNTS

extern "C" {

void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
void __libc_free(void*);

void* malloc(std::size_t size) noexcept
{
  ++heap_calls;
  heap_bytes += static_cast<long>(size);
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) noexcept
{
  ++heap_calls;
  heap_bytes += static_cast<long>(count * size);
  return __libc_calloc(count, size);
}
void* realloc(void* memory, std::size_t size) noexcept
{
  ++heap_calls;
  heap_bytes += static_cast<long>(size);
  return __libc_realloc(memory, size);
}
void* memalign(std::size_t alignment, std::size_t size) noexcept
{
  ++heap_calls;
  heap_bytes += static_cast<long>(size);
  return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) noexcept
{
  ++heap_calls;
  heap_bytes += static_cast<long>(size);
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** memory, std::size_t alignment, std::size_t size) noexcept
{
  ++heap_calls;
  heap_bytes += static_cast<long>(size);
  *memory = __libc_memalign(alignment, size);
  return *memory == nullptr ? ENOMEM : 0;
}
void free(void* memory) noexcept
{
  ++heap_calls;
  __libc_free(memory);
}

[[noreturn]] void __cxa_throw(void* object, void* type, void (*destroy)(void*))
{
  ++throws;
  using Throw = void (*)(void*, void*, void (*)(void*));
  reinterpret_cast<Throw>(dlsym(RTLD_NEXT, "__cxa_throw"))(object, type, destroy);
  std::abort();
}

}  // extern "C"

void* operator new(std::size_t size)
{
  ++heap_calls;
  heap_bytes += static_cast<long>(size);
  void* memory = __libc_malloc(size > 0 ? size : 1);
  if (memory == nullptr) { throw std::bad_alloc(); }
  return memory;
}
void* operator new(std::size_t size, std::align_val_t alignment)
{
  ++heap_calls;
  heap_bytes += static_cast<long>(size);
  void* memory = __libc_memalign(static_cast<std::size_t>(alignment), size > 0 ? size : 1);
  if (memory == nullptr) { throw std::bad_alloc(); }
  return memory;
}
void operator delete(void* memory) noexcept
{
  ++heap_calls;
  __libc_free(memory);
}
void operator delete(void* memory, std::size_t) noexcept
{
  ++heap_calls;
  __libc_free(memory);
}
void operator delete(void* memory, std::align_val_t) noexcept
{
  ++heap_calls;
  __libc_free(memory);
}
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept
{
  ++heap_calls;
  __libc_free(memory);
}

#endif

namespace iim::test {

struct Calls {
  long heap, thrown;
};

template <class F>
Calls count(F&& f)
{
  const long heap = heap_calls, thrown = throws;
  f();
  return {heap_calls - heap, throws - thrown};
}

}  // namespace iim::test
