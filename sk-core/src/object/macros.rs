//! The macros a user writes: `object!`, `attach!`, `detach!`.

use crate::object::Class;

/// A 64-bit number for `module::Class.member`: how signals and slots are told apart.
#[doc(hidden)]
pub const fn member_uid(module: &str, class: &str, member: &str) -> u64 {
    // Joined by folding, so that no string has to be built in a constant.
    let class = sk_flat::name_hash(module) ^ sk_flat::name_hash(class).rotate_left(21);
    class ^ sk_flat::name_hash(member).rotate_left(42)
}

/// Fails a build in which two members of a class have one number.
#[doc(hidden)]
pub const fn assert_distinct(uids: &[u64]) {
    let mut i = 0;
    while i < uids.len() {
        let mut j = i + 1;
        while j < uids.len() {
            assert!(
                uids[i] != uids[j],
                "two members of this class have the same name, or the same hash: rename one"
            );
            j += 1;
        }
        i += 1;
    }
}

/// Whether there is anything to call when an object of the class is spawned or buried.
#[doc(hidden)]
pub const fn has_hooks(own: &[&str], base: Option<&'static Class>) -> bool {
    match base {
        Some(base) => base.has_hooks || !own.is_empty(),
        None => !own.is_empty(),
    }
}

/// The table beside a struct: which of its fields are signals and which of its methods are slots.
///
/// ```
/// use sk_core::prelude::*;
///
/// #[derive(Default)]
/// pub struct Thermostat { target: f32, pub heat_wanted: Signal<bool> }
///
/// impl Thermostat {
///     pub fn on_temperature(&mut self, cx: &mut Cx, celsius: f32) {
///         self.heat_wanted.emit(cx, celsius < self.target);
///     }
///     fn on_destroy(&mut self, _cx: &mut Cx) {}
/// }
///
/// object! {
///     pub Thermostat { signals { heat_wanted(bool) } slots { on_temperature(f32) } hooks { on_destroy } }
/// }
/// ```
///
/// - A signal is a field `name: Signal<A>`: one argument is itself, several are a tuple of owned values,
///   none is `()`. A single `&str` is a `Signal<str>`.
/// - A slot is a method `fn name(&mut self, cx: &mut Cx, …)` that returns nothing or `Result<(), E: Display>`.
///   An argument written `&str`, `&[u8]` or `&Frame` is borrowed in direct calls and copied only when queued.
/// - Hooks: `on_spawn(&mut self, cx)` runs once the object stands in its tree, `on_destroy(&mut self, cx)` when
///   it is buried, while its children still live.
/// - `Motor : device = Device { … }` offers the signals and slots of the field `device: Device` as its own
///   (`extends` of the papers); hooks of the base run too, first at spawn and last at burial.
/// - `for[T] where[T: Clone + 'static] Filter<T> { … }` is a generic object.
#[macro_export]
macro_rules! object {
    (for[$($g:ident),*] where[$($w:tt)*] $($rest:tt)*) => { $crate::__object! { @head [$($g),*] [$($w)*] $($rest)* } };
    ($($rest:tt)*) => { $crate::__object! { @head [] [] $($rest)* } };
}

#[doc(hidden)]
#[macro_export]
macro_rules! __object {
    // The accessors' `Deref` shows the base's type, so they are as visible as the class is said to be; without
    // a base they can always be public, and a `pub` that is forgotten in the table does no harm.
    (@head $g:tt $w:tt $vis:vis $name:ident $(<$($ga:ident),*>)? : $field:ident = $base:ty {
            $(signals { $($(#[$sm:meta])* $signal:ident ( $($sarg:tt)* ))* })?
            $(slots { $($(#[$lm:meta])* $slot:ident ( $($larg:tt)* ))* })?
            $(hooks { $($hook:ident)* })?
        }
    ) => {
        $crate::__object! {
            @class [$vis] [$name] [$name $(<$($ga),*>)?] $g $w [$field = $base]
            [$($($signal ( $($sarg)* ))*)?] [$($($slot ( $($larg)* ))*)?] [$($($hook)*)?]
        }
    };

    (@head $g:tt $w:tt $vis:vis $name:ident $(<$($ga:ident),*>)? {
            $(signals { $($(#[$sm:meta])* $signal:ident ( $($sarg:tt)* ))* })?
            $(slots { $($(#[$lm:meta])* $slot:ident ( $($larg:tt)* ))* })?
            $(hooks { $($hook:ident)* })?
        }
    ) => {
        $crate::__object! {
            @class [pub] [$name] [$name $(<$($ga),*>)?] $g $w []
            [$($($signal ( $($sarg)* ))*)?] [$($($slot ( $($larg)* ))*)?] [$($($hook)*)?]
        }
    };

    (@class [$vis:vis] [$name:ident] [$self:ty] $g:tt $w:tt $base:tt
        $signals:tt [$($slot:ident ( $($larg:tt)* ))*] $hooks:tt
    ) => {
        const _: () = {
            $($crate::__slot! { [$name] [$self] $g $w $slot [$($larg)*] ( $($larg)* ) })*
            $crate::__object! { @items [$vis] [$name] [$self] $g $w $base $signals [$($slot)*] $hooks }
        };
    };

    (@items [$vis:vis] [$name:ident] [$self:ty] [$($g:ident),*] [$($w:tt)*] [$($base:tt)*]
        [$($signal:ident ( $($sarg:tt)* ))*] [$($slot:ident)*] [$($hook:ident)*]
    ) => {
            const fn __uid(member: &str) -> u64 {
                $crate::macro_support::member_uid(module_path!(), stringify!($name), member)
            }
            const _: () = $crate::macro_support::assert_distinct(&[$(__uid(stringify!($signal))),*]);
            const _: () = $crate::macro_support::assert_distinct(&[$(__uid(stringify!($slot))),*]);

            #[allow(dead_code)]
            $vis struct __Signals<P: $crate::object::Place, $($g),*> where $($w)* {
                place: P,
                base: $crate::__object!(@base_signals P [$($base)*]),
                own: ::core::marker::PhantomData<fn() -> ($($g,)*)>,
            }
            #[allow(dead_code)]
            $vis struct __Slots<P: $crate::object::Place, $($g),*> where $($w)* {
                place: P,
                base: $crate::__object!(@base_slots P [$($base)*]),
                own: ::core::marker::PhantomData<fn() -> ($($g,)*)>,
            }
            $crate::__object! { @deref [$self] [$($g),*] [$($w)*] [$($base)*] }

            #[allow(non_upper_case_globals)]
            trait __Metas {
                $(const $signal: &'static $crate::macro_support::SignalMeta;)*
            }
            impl<$($g),*> __Metas for $self where $($w)* {
                $(const $signal: &'static $crate::macro_support::SignalMeta = &$crate::macro_support::SignalMeta {
                    name: stringify!($signal),
                    class: stringify!($name),
                    args: stringify!($($sarg)*),
                    uid: __uid(stringify!($signal)),
                    args_type: || ::core::any::TypeId::of::<$crate::__carried!($($sarg)*)>(),
                    crossing: || {
                        #[allow(unused_imports)]
                        use $crate::macro_support::{Crossable, Staying};
                        (&&$crate::macro_support::Described::<$crate::__carried!($($sarg)*)>::new()).crossing()
                    },
                };)*
            }

            #[allow(dead_code)]
            impl<P: $crate::object::Place, $($g),*> __Signals<P, $($g),*> where $($w)* {
                $(pub fn $signal(
                    &self,
                ) -> $crate::macro_support::SignalRef<$crate::__carried!($($sarg)*), P> {
                    $crate::macro_support::SignalRef::new(self.place.clone(), <$self as __Metas>::$signal)
                })*
            }
            #[allow(dead_code)]
            impl<P: $crate::object::Place, $($g),*> __Slots<P, $($g),*> where $($w)* {
                $(pub fn $slot(&self) -> $crate::macro_support::SlotRef<$slot<$self>, P> {
                    $crate::macro_support::SlotRef::new(self.place.clone())
                })*
            }
            // An error about a struct without a table is not helped by a list of all classes there are.
            #[diagnostic::do_not_recommend]
            impl<$($g),*> $crate::object::SkObject for $self where $($w)* {
                type Signals<P: $crate::object::Place> = __Signals<P, $($g),*>;
                type Slots<P: $crate::object::Place> = __Slots<P, $($g),*>;
                const CLASS: &'static $crate::object::Class = &$crate::object::Class {
                    name: stringify!($name),
                    type_id: ::core::any::TypeId::of::<Self>(),
                    signals: &[$(<$self as __Metas>::$signal),*],
                    slots: &[$(<$slot<$self> as $crate::macro_support::SlotTag>::META),*],
                    base: $crate::__object!(@base_class [$($base)*]),
                    has_hooks: $crate::macro_support::has_hooks(
                        &[$(stringify!($hook)),*],
                        $crate::__object!(@base_class [$($base)*]),
                    ),
                };
                fn signals_of<P: $crate::object::Place>(place: &P) -> Self::Signals<P> {
                    __Signals {
                        place: place.clone(),
                        base: $crate::__object!(@base_accessor place signals_of [$($base)*]),
                        own: ::core::marker::PhantomData,
                    }
                }
                fn slots_of<P: $crate::object::Place>(place: &P) -> Self::Slots<P> {
                    __Slots {
                        place: place.clone(),
                        base: $crate::__object!(@base_accessor place slots_of [$($base)*]),
                        own: ::core::marker::PhantomData,
                    }
                }
                #[allow(unused_variables)]
                fn signal_mut(&mut self, uid: u64) -> Option<&mut dyn $crate::macro_support::AnySignal> {
                    $(if uid == const { __uid(stringify!($signal)) } {
                        let signal: &mut $crate::signal::Signal<$crate::__carried!($($sarg)*)> = &mut self.$signal;
                        return Some(signal);
                    })*
                    $crate::__object!(@base_call self [None] signal_mut(uid) [$($base)*])
                }
                #[allow(unused_variables)]
                fn each_signal(
                    &mut self,
                    f: &mut dyn FnMut(
                        &'static $crate::macro_support::SignalMeta,
                        &mut dyn $crate::macro_support::AnySignal,
                    ),
                ) {
                    $(f(<$self as __Metas>::$signal, &mut self.$signal);)*
                    $crate::__object!(@base_call self [()] each_signal(f) [$($base)*]);
                }
                fn part_mut(&mut self, part: ::core::any::TypeId) -> Option<&mut dyn ::core::any::Any> {
                    if part == ::core::any::TypeId::of::<Self>() {
                        return Some(self);
                    }
                    $crate::__object!(@base_call self [None] part_mut(part) [$($base)*])
                }
                #[allow(unused_variables)]
                fn bind_slot<O: $crate::object::SkObject, P: $crate::macro_support::Project<O, Self>>(
                    node: &::std::rc::Rc<$crate::macro_support::Node<O>>,
                    uid: u64,
                    args: ::core::any::TypeId,
                ) -> Option<$crate::macro_support::Bound> {
                    $(if uid == const { __uid(stringify!($slot)) } {
                        return <$slot<$self> as $crate::macro_support::SlotTag>::bind::<O, P>(node, args);
                    })*
                    $crate::__object!(@base_bind O P node uid args [$($base)*])
                }
                #[allow(unused_variables)]
                fn spawned(&mut self, cx: &mut $crate::Cx) {
                    $crate::__object!(@base_call self [()] spawned(cx) [$($base)*]);
                    $($crate::__object!(@hook on_spawn $hook self cx);)*
                }
                #[allow(unused_variables)]
                fn destroying(&mut self, cx: &mut $crate::Cx) {
                    $($crate::__object!(@hook on_destroy $hook self cx);)*
                    $crate::__object!(@base_call self [()] destroying(cx) [$($base)*]);
                }
            }
    };

    (@base_signals $p:ident []) => { () };
    (@base_signals $p:ident [$field:ident = $base:ty]) => { <$base as $crate::object::SkObject>::Signals<$p> };
    (@base_slots $p:ident []) => { () };
    (@base_slots $p:ident [$field:ident = $base:ty]) => { <$base as $crate::object::SkObject>::Slots<$p> };
    (@base_class []) => { None };
    (@base_class [$field:ident = $base:ty]) => { Some(<$base as $crate::object::SkObject>::CLASS) };
    (@base_accessor $place:ident $f:ident []) => { () };
    (@base_accessor $place:ident $f:ident [$field:ident = $base:ty]) => {
        <$base as $crate::object::SkObject>::$f($place)
    };
    (@base_call $self:ident [$none:expr] $f:ident($arg:ident) []) => { $none };
    (@base_call $self:ident [$none:expr] $f:ident($arg:ident) [$field:ident = $base:ty]) => {
        <$base as $crate::object::SkObject>::$f(&mut $self.$field, $arg)
    };
    (@base_bind $o:ident $p:ident $node:ident $uid:ident $args:ident []) => { None };
    (@base_bind $o:ident $p:ident $node:ident $uid:ident $args:ident [$field:ident = $base:ty]) => {
        <$base as $crate::object::SkObject>::bind_slot::<$o, $crate::macro_support::Through<$p, Self>>(
            $node, $uid, $args,
        )
    };
    (@deref [$self:ty] [$($g:ident),*] [$($w:tt)*] []) => {};
    (@deref [$self:ty] [] [] [$field:ident = $base:ty]) => {
        impl $crate::macro_support::Extends for $self {
            type Base = $base;
            fn base(&mut self) -> &mut $base {
                &mut self.$field
            }
        }
        // The accessors of the base are found through `Deref`, nearest class first.
        impl<P: $crate::object::Place> ::core::ops::Deref for __Signals<P> {
            type Target = <$base as $crate::object::SkObject>::Signals<P>;
            fn deref(&self) -> &Self::Target {
                &self.base
            }
        }
        impl<P: $crate::object::Place> ::core::ops::Deref for __Slots<P> {
            type Target = <$base as $crate::object::SkObject>::Slots<P>;
            fn deref(&self) -> &Self::Target {
                &self.base
            }
        }
    };
    (@hook on_spawn on_spawn $self:ident $cx:ident) => { Self::on_spawn($self, $cx) };
    (@hook on_destroy on_destroy $self:ident $cx:ident) => { Self::on_destroy($self, $cx) };
    (@hook on_spawn on_destroy $self:ident $cx:ident) => {};
    (@hook on_destroy on_spawn $self:ident $cx:ident) => {};
    (@hook $when:ident $other:ident $self:ident $cx:ident) => {
        compile_error!(concat!("there is no hook `", stringify!($other), "`: hooks are on_spawn and on_destroy"))
    };
}

/// What a signal with these declared arguments carries.
#[doc(hidden)]
#[macro_export]
macro_rules! __carried {
    () => { () };
    (& $l:lifetime $t:ty $(,)?) => { & $l $t };
    (& $t:ty $(,)?) => { $t };
    ($t:ty $(,)?) => { $t };
    ($($many:tt)+) => { $crate::__owned_tuple!([] $($many)+ ,) };
}

#[doc(hidden)]
#[macro_export]
macro_rules! __owned_tuple {
    ([$($done:ty),*] $(,)?) => { ($($done),*) };
    ([$($done:ty),*] & $l:lifetime $t:ty , $($rest:tt)*) => {
        $crate::__owned_tuple!([$($done,)* & $l $t] $($rest)*)
    };
    ([$($done:ty),*] & $t:ty , $($rest:tt)*) => {
        $crate::__owned_tuple!([$($done,)* <$t as ::std::borrow::ToOwned>::Owned] $($rest)*)
    };
    ([$($done:ty),*] $t:ty , $($rest:tt)*) => { $crate::__owned_tuple!([$($done,)* $t] $($rest)*) };
}

/// The type of one slot, by the shape of its arguments.
#[doc(hidden)]
#[macro_export]
macro_rules! __slot {
    ([$name:ident] $self:tt $g:tt $w:tt $slot:ident $shown:tt ()) => {
        $crate::__slot! { @tag [$name] $self $g $w $slot $shown [()] [bind_exact] [] 0usize }
        $crate::__slot! { @invoke $self $g $w $slot [()] (args) [] }
    };
    ([$name:ident] $self:tt $g:tt $w:tt $slot:ident $shown:tt (& $l:lifetime $t:ty $(,)?)) => {
        $crate::__slot! { @value [$name] $self $g $w $slot $shown [& $l $t] [bind_exact] [] }
    };
    ([$name:ident] $self:tt [$($g:ident),*] [$($w:tt)*] $slot:ident $shown:tt (& $t:ty $(,)?)) => {
        $crate::__slot! {
            @tag [$name] $self [$($g),*] [$($w)*] $slot $shown [<$t as ::std::borrow::ToOwned>::Owned]
            [bind_ref] [$t,] 1usize
        }
        $crate::__slot! {
            @generic $self [$($g),*] [$($w)*] $slot [::core::borrow::Borrow<$t>] args
            [::core::borrow::Borrow::<$t>::borrow(args)]
        }
    };
    ([$name:ident] $self:tt $g:tt $w:tt $slot:ident $shown:tt (String $(,)?)) => {
        $crate::__slot! { @value [$name] $self $g $w $slot $shown [String] [bind_str] [] }
    };
    ([$name:ident] $self:tt $g:tt $w:tt $slot:ident $shown:tt (Vec<$t:ty> $(,)?)) => {
        $crate::__slot! { @value [$name] $self $g $w $slot $shown [Vec<$t>] [bind_slice] [$t,] }
    };
    ([$name:ident] $self:tt $g:tt $w:tt $slot:ident $shown:tt ($t:ty $(,)?)) => {
        $crate::__slot! { @value [$name] $self $g $w $slot $shown [$t] [bind_exact] [] }
    };
    ([$name:ident] $self:tt $g:tt $w:tt $slot:ident $shown:tt ($($many:tt)+)) => {
        $crate::__slot! { @many [$name] $self $g $w $slot $shown [] $($many)+ , }
    };

    // Several arguments: each is named, with its owned type and how the method wants it.
    (@many [$name:ident] $self:tt $g:tt $w:tt $slot:ident [$($shown:tt)*]
        [$([$arg:ident $owned:ty, $pass:expr])*] $(,)?
    ) => {
        $crate::__slot! {
            @tag [$name] $self $g $w $slot [$($shown)*] [($($owned),*)] [bind_exact] []
            (0usize $(+ $crate::__slot!(@one $arg))*)
        }
        $crate::__slot! { @invoke $self $g $w $slot [($($owned),*)] (($($arg),*)) [$($pass),*] }
    };
    (@many $name:tt $self:tt $g:tt $w:tt $slot:ident $shown:tt [$($done:tt)*] & $l:lifetime $t:ty , $($rest:tt)*) => {
        $crate::__slot! { @many $name $self $g $w $slot $shown [$($done)* [arg & $l $t, *arg]] $($rest)* }
    };
    (@many $name:tt $self:tt $g:tt $w:tt $slot:ident $shown:tt [$($done:tt)*] & $t:ty , $($rest:tt)*) => {
        $crate::__slot! { @many $name $self $g $w $slot $shown
            [$($done)* [arg <$t as ::std::borrow::ToOwned>::Owned, ::core::borrow::Borrow::<$t>::borrow(arg)]]
            $($rest)* }
    };
    (@many $name:tt $self:tt $g:tt $w:tt $slot:ident $shown:tt [$($done:tt)*] $t:ty , $($rest:tt)*) => {
        $crate::__slot! { @many $name $self $g $w $slot $shown
            [$($done)* [arg $t, ::core::clone::Clone::clone(arg)]] $($rest)* }
    };
    (@one $arg:ident) => { 1usize };

    // One argument by value: a signal may carry what it is the owned form of.
    (@value $name:tt $self:tt $g:tt $w:tt $slot:ident $shown:tt [$t:ty] $bind:tt $turbo:tt) => {
        $crate::__slot! { @tag $name $self $g $w $slot $shown [$t] $bind $turbo 1usize }
        $crate::__slot! {
            @generic $self $g $w $slot [::std::borrow::ToOwned<Owned = $t>] args
            [::std::borrow::ToOwned::to_owned(args)]
        }
    };

    (@tag [$name:ident] [$self:ty] [$($g:ident),*] [$($w:tt)*] $slot:ident [$($shown:tt)*] [$args:ty]
        [$bind:ident] [$($turbo:tt)*] $count:expr
    ) => {
        #[allow(non_camel_case_types)]
        pub struct $slot<O> {
            of: ::core::marker::PhantomData<fn() -> O>,
        }
        impl<$($g),*> $crate::macro_support::SlotTag for $slot<$self> where $($w)* {
            type Object = $self;
            type Args = $args;
            const META: &'static $crate::macro_support::SlotMeta = &$crate::macro_support::SlotMeta {
                name: stringify!($slot),
                class: stringify!($name),
                args: stringify!($($shown)*),
                uid: __uid(stringify!($slot)),
                args_type: || ::core::any::TypeId::of::<$args>(),
                prepare: |bound, args| {
                    #[allow(unused_imports)]
                    use $crate::macro_support::{Convertible, FixedConversion};
                    (&&$crate::macro_support::Described::<$args>::new()).prepare($count, bound, args)
                },
            };
            fn bind<O: $crate::object::SkObject, P: $crate::macro_support::Project<O, $self>>(
                node: &::std::rc::Rc<$crate::macro_support::Node<O>>,
                args: ::core::any::TypeId,
            ) -> Option<$crate::macro_support::Bound> {
                $crate::macro_support::$bind::<$($turbo)* O, P, Self>(node, args)
            }
        }
    };
    (@generic [$self:ty] [$($g:ident),*] [$($w:tt)*] $slot:ident [$($bound:tt)*] $args:ident [$pass:expr]) => {
        // So that an error names the slot and the signal's type and not a bound of this implementation.
        #[diagnostic::do_not_recommend]
        impl<__A: ?Sized + $($bound)*, $($g),*> $crate::macro_support::SlotFor<__A> for $slot<$self>
        where $($w)*
        {
            #[inline]
            fn invoke(object: &mut $self, cx: &mut $crate::Cx, $args: &__A) -> $crate::macro_support::Outcome {
                $crate::macro_support::IntoOutcome::into_outcome(<$self>::$slot(object, cx, $pass))
            }
        }
    };
    (@invoke [$self:ty] [$($g:ident),*] [$($w:tt)*] $slot:ident [$carried:ty] ($args:pat) [$($pass:expr),*]) => {
        #[diagnostic::do_not_recommend]
        impl<$($g),*> $crate::macro_support::SlotFor<$carried> for $slot<$self> where $($w)* {
            #[inline]
            #[allow(unused_variables)]
            fn invoke(object: &mut $self, cx: &mut $crate::Cx, $args: &$carried) -> $crate::macro_support::Outcome {
                $crate::macro_support::IntoOutcome::into_outcome(<$self>::$slot(object, cx, $($pass),*))
            }
        }
    };
}

/// Asks for a link from a signal to a slot: `attach!(cx, probe.measured => thermo.on_temperature, Queued)`.
///
/// Source and target are a [`Handle`](crate::Handle) or a [`Remote`](crate::Remote), or an expression that gives
/// one. The mode is [`Direct`](crate::signal::Direct) if left out; [`Queued`](crate::signal::Queued),
/// [`Latest`](crate::signal::Latest), [`OneShot`](crate::signal::OneShot), and `Queued.once()`, `Latest.once()`.
/// The argument lists must match, though borrowing does not count; `target.slot()` takes a slot without
/// arguments, whatever the signal carries.
///
/// The request is carried out at the end of the round; the link first fires in the next one. A pair already
/// linked changes nothing, whatever the mode.
///
/// A misspelt slot does not compile:
/// ```compile_fail
/// use sk_core::prelude::*;
/// #[derive(Default)] struct Lamp { lit: Signal<bool> }
/// impl Lamp { fn switch(&mut self, _cx: &mut Cx, _on: bool) {} }
/// object! { Lamp { signals { lit(bool) } slots { switch(bool) } } }
/// let mut app = SkApp::new();
/// let cx = app.cx();
/// let lamp = cx.spawn(Lamp::default());
/// attach!(cx, lamp.lit => lamp.swich);
/// ```
#[macro_export]
macro_rules! attach {
    ($cx:expr, $($rest:tt)+) => { $crate::__attach! { @source [$cx] [] $($rest)+ } };
}

/// Asks to cut a link: `detach!(cx, probe.measured => thermo.on_temperature)`. It may still fire in this
/// round; calls that are queued already are delivered. A pair that is not linked is no error.
#[macro_export]
macro_rules! detach {
    ($cx:expr, $($rest:tt)+) => { $crate::__detach! { @source [$cx] [] $($rest)+ } };
}

#[doc(hidden)]
#[macro_export]
macro_rules! __attach {
    (@source [$cx:expr] [$($before:tt)+] . $signal:ident => $($target:tt)+) => {
        $crate::__attach! { @target [$cx] [($($before)+).signals().$signal()] [] $($target)+ }
    };
    (@source [$cx:expr] [$($before:tt)*] $t:tt $($rest:tt)+) => {
        $crate::__attach! { @source [$cx] [$($before)* $t] $($rest)+ }
    };
    (@target [$cx:expr] [$signal:expr] [$($before:tt)+] . $slot:ident) => {
        $crate::__attach! { @emit [$cx] [$signal] [($($before)+).slots().$slot()] attach [$crate::signal::Direct] }
    };
    (@target [$cx:expr] [$signal:expr] [$($before:tt)+] . $slot:ident , $mode:expr) => {
        $crate::__attach! { @emit [$cx] [$signal] [($($before)+).slots().$slot()] attach [$mode] }
    };
    (@target [$cx:expr] [$signal:expr] [$($before:tt)+] . $slot:ident ()) => {
        $crate::__attach! {
            @emit [$cx] [$signal] [($($before)+).slots().$slot()] attach_ignoring [$crate::signal::Direct]
        }
    };
    (@target [$cx:expr] [$signal:expr] [$($before:tt)+] . $slot:ident () , $mode:expr) => {
        $crate::__attach! { @emit [$cx] [$signal] [($($before)+).slots().$slot()] attach_ignoring [$mode] }
    };
    (@target [$cx:expr] [$signal:expr] [$($before:tt)*] $t:tt $($rest:tt)+) => {
        $crate::__attach! { @target [$cx] [$signal] [$($before)* $t] $($rest)+ }
    };
    (@emit [$cx:expr] [$signal:expr] [$slot:expr] $attach:ident [$mode:expr]) => {{
        let signal = $signal;
        let slot = $slot;
        $crate::macro_support::$attach($cx, signal, slot, $mode)
    }};
}

#[doc(hidden)]
#[macro_export]
macro_rules! __detach {
    (@source [$cx:expr] [$($before:tt)+] . $signal:ident => $($target:tt)+) => {
        $crate::__detach! { @target [$cx] [($($before)+).signals().$signal()] [] $($target)+ }
    };
    (@source [$cx:expr] [$($before:tt)*] $t:tt $($rest:tt)+) => {
        $crate::__detach! { @source [$cx] [$($before)* $t] $($rest)+ }
    };
    (@target [$cx:expr] [$signal:expr] [$($before:tt)+] . $slot:ident $(())?) => {{
        let signal = $signal;
        let slot = ($($before)+).slots().$slot();
        $crate::macro_support::detach($cx, signal, slot)
    }};
    (@target [$cx:expr] [$signal:expr] [$($before:tt)*] $t:tt $($rest:tt)+) => {
        $crate::__detach! { @target [$cx] [$signal] [$($before)* $t] $($rest)+ }
    };
}
