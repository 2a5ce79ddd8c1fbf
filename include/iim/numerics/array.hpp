// The array in which the library keeps what it holds of subsystems, frames and inputs. It does what std::vector does
// and takes less than half of its time to compile; a controller has some sixty kinds of elements (its g++ -O3: 0.85 of
// the time).
#pragma once

#include <cstddef>
#include <iterator>
#include <limits>
#include <new>

namespace iim::detail {

/// A number of the tree's, or a column, as a subscript.
constexpr std::size_t at(std::ptrdiff_t i) { return static_cast<std::size_t>(i); }

/// Memory for `count` elements. Throws std::bad_alloc.
[[gnu::cold]] inline void* element_memory(std::size_t count, std::size_t size, std::size_t alignment)
{
  if (count > static_cast<std::size_t>(std::numeric_limits<std::ptrdiff_t>::max()) / size) {
    throw std::bad_array_new_length();
  }
  return alignment > __STDCPP_DEFAULT_NEW_ALIGNMENT__ ? ::operator new(count * size, std::align_val_t(alignment))
                                                      : ::operator new(count * size);
}

[[gnu::cold]] inline void free_element_memory(void* memory, std::size_t alignment) noexcept
{
  if (alignment > __STDCPP_DEFAULT_NEW_ALIGNMENT__) {
    ::operator delete(memory, std::align_val_t(alignment));
  } else {
    ::operator delete(memory);
  }
}

/// Elements one behind the other, as many as are asked for at run time. Members mean what they mean for std::vector. If
/// an element cannot be copied or moved, by an exception, the array holds fewer elements, or some that were moved from.
template <class T>
class Array {
public:
  Array() = default;
  explicit Array(std::size_t size) : Array() { resize(size); }
  Array(std::size_t size, const T& value) : Array() { resize(size, value); }
  Array(const Array& other) : Array()
  {
    reserve(other.room_);  // what grows in the cycle does not allocate in a copy either
    append(other.begin(), other.end());
  }
  Array(Array&& other) noexcept { swap(other); }
  Array& operator=(const Array& other)
  {
    if (this != &other) {
      clear();
      reserve(other.room_);
      append(other.begin(), other.end());
    }
    return *this;
  }
  Array& operator=(Array&& other) noexcept
  {
    Array moved(static_cast<Array&&>(other));
    swap(moved);
    return *this;
  }
  ~Array()
  {
    clear();
    free_element_memory(begin_, alignof(T));
  }

  bool empty() const { return size_ == 0; }
  std::size_t size() const { return size_; }
  T* data() { return begin_; }
  const T* data() const { return begin_; }
  T* begin() { return begin_; }
  const T* begin() const { return begin_; }
  T* end() { return begin_ + size_; }
  const T* end() const { return begin_ + size_; }
  auto rbegin() { return std::reverse_iterator<T*>(end()); }
  auto rbegin() const { return std::reverse_iterator<const T*>(end()); }
  auto rend() { return std::reverse_iterator<T*>(begin_); }
  auto rend() const { return std::reverse_iterator<const T*>(begin_); }

  T& operator[](std::size_t i) { return begin_[i]; }
  const T& operator[](std::size_t i) const { return begin_[i]; }
  T& front() { return begin_[0]; }
  const T& front() const { return begin_[0]; }
  T& back() { return begin_[size_ - 1]; }
  const T& back() const { return begin_[size_ - 1]; }

  void reserve(std::size_t size)
  {
    if (size > room_) { move_to(size); }
  }
  void resize(std::size_t size)
  {
    keep(size);
    reserve(size);
    for (; size_ < size; ++size_) { ::new (static_cast<void*>(begin_ + size_)) T(); }
  }
  void resize(std::size_t size, T value)
  {
    keep(size);
    reserve(size);
    for (; size_ < size; ++size_) { ::new (static_cast<void*>(begin_ + size_)) T(value); }
  }
  void assign(std::size_t size, T value)
  {
    clear();
    resize(size, static_cast<T&&>(value));
  }
  /// Behind the last element; first and last do not lie in this array.
  template <class Iterator>
  void append(Iterator first, Iterator last)
  {
    reserve(size_ + static_cast<std::size_t>(last - first));
    for (; first != last; ++first, ++size_) { ::new (static_cast<void*>(begin_ + size_)) T(*first); }
  }
  void push_back(T value)
  {
    if (size_ == room_) { move_to(2 * size_ + 1); }
    ::new (static_cast<void*>(begin_ + size_)) T(static_cast<T&&>(value));
    ++size_;
  }
  template <class... Arguments>
  void emplace_back(Arguments&&... arguments)
  {
    push_back(T(static_cast<Arguments&&>(arguments)...));
  }
  void pop_back() { keep(size_ - 1); }
  void clear() noexcept { keep(0); }

private:
  /// The first `size`, if there are more.
  void keep(std::size_t size) noexcept
  {
    while (size_ > size) { begin_[--size_].~T(); }
  }

  [[gnu::cold]] void move_to(std::size_t room)
  {
    Array moved;
    moved.begin_ = static_cast<T*>(element_memory(room, sizeof(T), alignof(T)));
    moved.room_ = room;
    for (std::size_t& i = moved.size_; i < size_; ++i) {
      ::new (static_cast<void*>(moved.begin_ + i)) T(static_cast<T&&>(begin_[i]));
    }
    swap(moved);
  }

  void swap(Array& other) noexcept
  {
    T* const begin = begin_;
    const std::size_t size = size_, room = room_;
    begin_ = other.begin_, size_ = other.size_, room_ = other.room_;
    other.begin_ = begin, other.size_ = size, other.room_ = room;
  }

  T* begin_ = nullptr;
  std::size_t size_ = 0;
  std::size_t room_ = 0;
};

}  // namespace iim::detail
