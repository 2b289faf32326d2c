// What a statement of Warp's generated code costs, from the types in it; put in front of the code that is to be counted.
// EVIS_ADD(i, n) adds n to the i-th counter: 0 bytes of arrays, 1 operations, 2 calls of native code.

namespace evis_counts {

template <class T> struct plain { using type = T; };
template <class T> struct plain<T&> { using type = T; };
template <class T> struct plain<const T> { using type = T; };
template <class T> struct plain<const T&> { using type = T; };

template <class T> struct numbers { static constexpr unsigned value = 1; };
template <unsigned N, class T> struct numbers<wp::vec_t<N, T>> { static constexpr unsigned value = N; };
template <unsigned R, unsigned C, class T> struct numbers<wp::mat_t<R, C, T>> { static constexpr unsigned value = R * C; };
template <class T> struct numbers<wp::quat_t<T>> { static constexpr unsigned value = 4; };
template <class T> struct numbers<wp::transform_t<T>> { static constexpr unsigned value = 7; };

template <class A, class B> struct product {
  static constexpr unsigned value = numbers<A>::value > numbers<B>::value ? numbers<A>::value : numbers<B>::value;
};
template <unsigned R, unsigned C, class T> struct product<wp::mat_t<R, C, T>, wp::vec_t<C, T>> {
  static constexpr unsigned value = R * (2 * C - 1);
};
template <unsigned R, unsigned C, class T> struct product<wp::vec_t<R, T>, wp::mat_t<R, C, T>> {
  static constexpr unsigned value = C * (2 * R - 1);
};
template <unsigned R, unsigned K, unsigned C, class T> struct product<wp::mat_t<R, K, T>, wp::mat_t<K, C, T>> {
  static constexpr unsigned value = R * C * (2 * K - 1);
};
template <class T> struct product<wp::quat_t<T>, wp::quat_t<T>> { static constexpr unsigned value = 28; };

}  // namespace evis_counts

#define EVIS_NUMBERS(x) evis_counts::numbers<typename evis_counts::plain<decltype(x)>::type>::value
#define EVIS_PRODUCT(a, b) \
  evis_counts::product<typename evis_counts::plain<decltype(a)>::type, typename evis_counts::plain<decltype(b)>::type>::value
#if defined(__CUDA_ARCH__)
#define EVIS_ADD(i, n) atomicAdd((unsigned long long*)EVIS_COUNTERS + i, (unsigned long long)(n))
#else
#define EVIS_ADD(i, n) ((unsigned long long*)EVIS_COUNTERS)[i] += (n)
#endif
