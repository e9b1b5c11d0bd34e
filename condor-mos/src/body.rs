//! [`LoopBody`]: what a loop runs, without its type.

use crate::instant::CounterReading;

/// The body of a loop, without the type of the program's closure or function: a pointer to a
/// function, and a pointer to the data that the function uses.
///
/// The function also gets the instant, of type `I`, at which the run was due.
#[derive(Clone, Copy, Debug)]
pub struct LoopBody<I> {
    call: unsafe fn(*mut (), I),
    context: *mut (),
}

// SAFETY: both ways to make one ask for a context that is `Send`, and it is used by one context of
// the processor at a time.
unsafe impl<I> Send for LoopBody<I> {}

impl<I: CounterReading> LoopBody<I> {
    /// Of a loop that has none yet: does nothing.
    pub(crate) const NOTHING: Self = {
        unsafe fn nothing<I>(_: *mut (), _: I) {}
        Self {
            call: nothing::<I>,
            context: core::ptr::null_mut(),
        }
    };

    /// Returns true if this body is [`NOTHING`](Self::NOTHING): all others have a context.
    pub(crate) const fn is_nothing(&self) -> bool {
        self.context.is_null()
    }

    /// A function that is given `context` for as long as it is called.
    pub(crate) fn of_function<C: Send>(function: fn(&mut C, I), context: &mut C) -> Self {
        // SAFETY: `&mut C` and `*mut ()` are ABI-compatible, as `C` is `Sized`; every caller passes a pointer
        // to a `C`, and calls an unsafe function.
        let call =
            unsafe { core::mem::transmute::<fn(&mut C, I), unsafe fn(*mut (), I)>(function) };
        Self {
            call,
            context: core::ptr::from_mut(context).cast(),
        }
    }

    /// A closure.
    pub(crate) fn of_closure<F: FnMut(I) + Send>(closure: &mut F) -> Self {
        /// # Safety
        /// `closure` points to an `F` that nobody else uses.
        unsafe fn call<I, F: FnMut(I)>(closure: *mut (), due: I) {
            // SAFETY: as the caller promises.
            unsafe { (*closure.cast::<F>())(due) }
        }
        Self {
            call: call::<I, F>,
            context: core::ptr::from_mut(closure).cast(),
        }
    }

    /// Runs it once.
    ///
    /// # Safety
    /// The context that was given still exists, and nobody else uses it during the call.
    #[inline]
    pub(crate) unsafe fn call(self, due: I) {
        // SAFETY: `context` points to what `call` expects, by construction, and is alive and not
        // shared, as the caller promises.
        unsafe { (self.call)(self.context, due) }
    }
}
